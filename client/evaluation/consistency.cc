#include "client/evaluation/consistency.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <numbers>
#include <optional>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/evaluation/real_consistency.h"
#include "client/evaluation/revisits.h"
#include "client/evaluation/road_truth.h"
#include "client/evaluation/submap_run.h"
#include "client/evaluation/town_drive.h"
#include "core/base/parallel_for.h"
#include "core/base/status_macros.h"

namespace gem::evaluation {
namespace {

constexpr char kRealScans[] = "kitti_00_keyframes";
constexpr double kDegPerRad = 180 / std::numbers::pi;
constexpr double kGap_s = 60;
constexpr float kCell_m = 0.2f;
constexpr float kSubmap_m = 10;
constexpr float kCoarserSubmap_m = 20;
constexpr float kSide_m = 12;  // the paper's for Fig. 15 and 16
constexpr std::size_t kInventedScans = 4541;

/// One way to make a map of the drive.
struct MapFindings {
  std::string name;
  std::vector<TwicePassed> twice;  ///< empty where submaps were merged
  Deviation deviation;
  Deviation error;  ///< against the town's ground
};

struct DriveFindings {
  TownDrive town;
  std::size_t num_corrections = 0;
  std::size_t cells_differ = 0;  ///< between many corrections and one at the end
  MapFindings uncorrected;
  MapFindings deformed;
  MapFindings coarser;
  MapFindings merged;
  MapFindings from_start;
};

GlobalMapOptions MapOptions(bool merge, int threads) {
  GlobalMapOptions options;
  options.cell_size_m = kCell_m;
  options.compose_threads = threads;
  if (!merge) options.merge_overlap_min = 1000;
  return options;
}

struct Runs {
  std::unique_ptr<SubmapRecorder> odometry;
  std::unique_ptr<SubmapRecorder> coarser;  ///< the same with longer submaps
  std::unique_ptr<SubmapRecorder> corrected;
};

absl::StatusOr<Runs> MapScans(const TownDrive& town, const Settings& settings, double begin,
                              double share) {
  LocalMapOptions local;
  local.cell_size_m = kCell_m;
  local.side_m = kSide_m;
  Runs runs;
  GEM_ASSIGN_OR_RETURN(runs.odometry, SubmapRecorder::Make(local, kSubmap_m));
  GEM_ASSIGN_OR_RETURN(runs.coarser, SubmapRecorder::Make(local, kCoarserSubmap_m));
  GEM_ASSIGN_OR_RETURN(runs.corrected, SubmapRecorder::Make(local, kSubmap_m));
  const Drive& drive = town.drive;
  CastScans(town, {.lidar = TownLidar(400), .threads = settings.threads, .seed = settings.seed},
            [&](std::size_t i, std::span<const ScanPoint> points) {
              const Pose<Global, Base>& pose = drive.corrected[i];
              const Pose<Odom, Base> T_O_B(pose.rotation(), pose.translation());
              ParallelFor(3, settings.threads, [&](std::size_t which) {
                if (which == 0) runs.odometry->Fuse(drive.stamps_ns[i], drive.odometry[i], points);
                if (which == 1) runs.coarser->Fuse(drive.stamps_ns[i], drive.odometry[i], points);
                if (which == 2) runs.corrected->Fuse(drive.stamps_ns[i], T_O_B, points);
              });
              if (i % 64 == 0)
                settings.progress(drive.name, begin + share * static_cast<double>(i) /
                                                          static_cast<double>(drive.size()));
            });
  runs.odometry->End();
  runs.coarser->End();
  runs.corrected->End();
  return runs;
}

/// As SLAM would: at every loop all poses so far, and at the end all.
absl::Status CorrectAtLoops(const TownDrive& town, const SubmapRun& run,
                            const std::vector<std::size_t>& closures, MapReplay& map) {
  for (const std::size_t scan : closures) {
    map.TellUntil(scan);
    GEM_RETURN_IF_ERROR(map.Correct(CorrectionOf(run, town.drive.corrected, scan + 1)));
    map.Commit();
  }
  map.TellUntil(town.drive.size());
  GEM_RETURN_IF_ERROR(map.Correct(CorrectionOf(run, town.drive.corrected, town.drive.size())));
  map.Commit();
  return absl::OkStatus();
}

MapFindings Look(std::string name, const SubmapRun& run, const MapSnapshot& map, bool merged,
                 const RoadTruth& truth) {
  MapFindings findings;
  findings.name = std::move(name);
  if (!merged) {
    findings.twice =
        PassedTwice(LaySubmaps(run, map), kCell_m, kGap_s, map.options.traversability_free);
    findings.deviation = DeviationOf(findings.twice);
  }
  findings.error = ErrorAgainst(map, [&truth](double x_m, double y_m) { return truth(x_m, y_m); });
  return findings;
}

absl::StatusOr<DriveFindings> Investigate(Drive drive, const Settings& settings, double begin,
                                          double share) {
  DriveFindings findings;
  findings.town = BuildTownDrive(std::move(drive), settings.seed);
  const TownDrive& town = findings.town;
  GEM_ASSIGN_OR_RETURN(const Runs runs, MapScans(town, settings, begin, 0.8 * share));
  const SubmapRun& run = runs.odometry->run();
  const RoadTruth truth(town);
  const Drive& seated = town.drive;
  const Pose<Global, Odom> T_G_O = seated.corrected.front() * seated.odometry.front().Inverse();
  const std::vector<std::size_t> closures = LoopClosures(seated.truth, seated.stamps_ns, {});
  findings.num_corrections = closures.size() + 1;

  MapReplay uncorrected(run, MapOptions(false, settings.threads), T_G_O);
  uncorrected.TellUntil(seated.size());
  uncorrected.Commit();
  findings.uncorrected = Look("odometry", run, uncorrected.snapshot(), false, truth);

  MapReplay deformed(run, MapOptions(false, settings.threads), T_G_O);
  GEM_RETURN_IF_ERROR(CorrectAtLoops(town, run, closures, deformed));
  findings.deformed = Look("deformed", run, deformed.snapshot(), false, truth);

  MapReplay coarser(runs.coarser->run(), MapOptions(false, settings.threads), T_G_O);
  GEM_RETURN_IF_ERROR(CorrectAtLoops(town, runs.coarser->run(), closures, coarser));
  findings.coarser = Look("deformed, 20 m", runs.coarser->run(), coarser.snapshot(), false, truth);

  MapReplay once(run, MapOptions(false, settings.threads), T_G_O);
  GEM_RETURN_IF_ERROR(CorrectAtLoops(town, run, {}, once));
  findings.cells_differ = CellsThatDiffer(deformed.snapshot(), once.snapshot());

  MapReplay merged(run, MapOptions(true, settings.threads), T_G_O);
  GEM_RETURN_IF_ERROR(CorrectAtLoops(town, run, closures, merged));
  findings.merged = Look("deformed, merged", run, merged.snapshot(), true, truth);
  settings.progress(seated.name, begin + 0.95 * share);

  const SubmapRun& start_run = runs.corrected->run();
  MapReplay from_start(start_run, MapOptions(false, settings.threads), {});
  from_start.TellUntil(seated.size());
  from_start.Commit();
  findings.from_start = Look("corrected poses", start_run, from_start.snapshot(), false, truth);
  return findings;
}

std::string Centimetres(double metres) { return absl::StrFormat("%.1f", 100 * metres); }

Table MapsTable(const DriveFindings& findings) {
  Table table;
  table.title = absl::StrCat(findings.town.drive.name, ": free cells that were passed twice");
  table.columns = {"map",      "cells passed twice",  "rms, cm",    "median, cm",
                   "95 %, cm", "road: rms error, cm", "road: cells"};
  for (const MapFindings* map :
       {&findings.uncorrected, &findings.deformed, &findings.from_start, &findings.merged}) {
    const Deviation& d = map->deviation;
    const bool merged = map == &findings.merged;
    table.rows.push_back(
        {map->name, merged ? "-" : absl::StrCat(d.cells), merged ? "-" : Centimetres(d.rms_m),
         merged ? "-" : Centimetres(d.median_m), merged ? "-" : Centimetres(d.p95_m),
         Centimetres(map->error.rms_m), absl::StrCat(map->error.cells)});
  }
  return table;
}

/// Deviation in the three squares that hold the most cells passed twice, as in Fig. 16.
Table RegionsTable(const DriveFindings& findings) {
  constexpr double kRegion_m = 64;
  const auto region_of = [](const TwicePassed& cell) {
    return CellAt(CenterOf(cell.cell.x, kCell_m), CenterOf(cell.cell.y, kCell_m), kRegion_m);
  };
  absl::flat_hash_map<std::uint64_t, std::size_t> count;
  for (const TwicePassed& cell : findings.from_start.twice) ++count[PackedKey(region_of(cell))];
  std::vector<std::pair<std::size_t, std::uint64_t>> regions;
  for (const auto& [key, cells] : count) regions.emplace_back(cells, key);
  std::sort(regions.rbegin(), regions.rend());
  regions.resize(std::min<std::size_t>(regions.size(), 3));

  Table table;
  table.title =
      absl::StrCat(findings.town.drive.name, ": rms deviation in three regions of 64 m, cm");
  table.columns = {"map", "region 1", "region 2", "region 3"};
  table.columns.resize(1 + regions.size());
  for (const MapFindings* map : {&findings.uncorrected, &findings.deformed, &findings.from_start}) {
    std::vector<std::string> row = {map->name};
    for (const auto& [cells, key] : regions) {
      std::vector<TwicePassed> inside;
      for (const TwicePassed& cell : map->twice)
        if (PackedKey(region_of(cell)) == key) inside.push_back(cell);
      const Deviation deviation = DeviationOf(inside);
      row.push_back(deviation.cells == 0 ? "-" : Centimetres(deviation.rms_m));
    }
    table.rows.push_back(std::move(row));
  }
  return table;
}

Plot WayPlot(const DriveFindings& findings) {
  const Drive& drive = findings.town.drive;
  Plot plot;
  plot.name = absl::StrCat("way_", drive.name);
  plot.title = absl::StrCat(drive.name, ": the way, by odometry and corrected");
  plot.x_label = "x of G, m";
  plot.y_label = "y of G, m";
  const Pose<Global, Odom> T_G_O = drive.corrected.front() * drive.odometry.front().Inverse();
  Series odometry{.name = "odometry"};
  Series corrected{.name = "corrected"};
  for (std::size_t i = 0; i < drive.size(); i += 4) {
    const Eigen::Vector3d by_odometry_m = (T_G_O * drive.odometry[i]).translation();
    odometry.x.push_back(by_odometry_m.x());
    odometry.y.push_back(by_odometry_m.y());
    corrected.x.push_back(drive.corrected[i].translation().x());
    corrected.y.push_back(drive.corrected[i].translation().y());
  }
  plot.series = {std::move(odometry), std::move(corrected)};
  return plot;
}

/// How much of the ground deviates by at most so much.
Plot SharePlot(const DriveFindings& findings) {
  Plot plot;
  plot.name = absl::StrCat("deviation_", findings.town.drive.name);
  plot.title =
      absl::StrCat(findings.town.drive.name, ": height between two passes over the same cell");
  plot.x_label = "deviation, cm (logarithm to base 10)";
  plot.y_label = "cells with at most this deviation, %";
  for (const MapFindings* map : {&findings.uncorrected, &findings.deformed, &findings.from_start}) {
    std::vector<double> values;
    for (const TwicePassed& cell : map->twice)
      values.push_back(100.0 * std::abs(static_cast<double>(cell.later_m) - cell.first_m));
    std::sort(values.begin(), values.end());
    Series series{.name = map->name};
    for (int percent = 1; percent < 100 && !values.empty(); ++percent) {
      const std::size_t at = values.size() * static_cast<std::size_t>(percent) / 100;
      series.x.push_back(std::log10(std::max(values[at], 0.01)));
      series.y.push_back(percent);
    }
    plot.series.push_back(std::move(series));
  }
  return plot;
}

double OdometryErrorMax_m(const Drive& drive, bool vertical) {
  const Pose<Global, Odom> T_G_O = drive.corrected.front() * drive.odometry.front().Inverse();
  double error_m_max = 0;
  for (std::size_t i = 0; i < drive.size(); ++i) {
    const Eigen::Vector3d error_m =
        (T_G_O * drive.odometry[i]).translation() - drive.truth[i].translation();
    error_m_max =
        std::max(error_m_max, vertical ? std::abs(error_m.z()) : error_m.head<2>().norm());
  }
  return error_m_max;
}

std::vector<std::string> DriveRow(const DriveFindings& findings) {
  const Drive& drive = findings.town.drive;
  return {
      drive.name,
      absl::StrCat(drive.size()),
      absl::StrFormat("%.2f", LengthOf(drive) / 1000),
      absl::StrFormat("%.1f", OdometryErrorMax_m(drive, false)),
      absl::StrFormat("%.1f", OdometryErrorMax_m(drive, true)),
      absl::StrFormat("%.2f", TurnDifferenceRms_rad(drive.odometry, drive.truth, 10) * kDegPerRad),
      absl::StrFormat("%.2f", findings.town.lift_m_rms),
      absl::StrCat(findings.num_corrections)};
}

void AddFindings(const DriveFindings& findings, Report& report) {
  const std::string& name = findings.town.drive.name;
  report.tables.push_back(MapsTable(findings));
  if (findings.from_start.deviation.cells == 0) {
    report.skipped.push_back(
        absl::StrCat(name, ": no cell was passed twice in so short a stretch of the way"));
    return;
  }
  const double from_start_m = findings.from_start.deviation.rms_m;
  report.tables.push_back(RegionsTable(findings));
  report.plots.push_back(SharePlot(findings));
  report.plots.push_back(WayPlot(findings));
  report.figures.push_back({.name = absl::StrCat(name, ": deviation without deformation, rms"),
                            .value = 100 * findings.uncorrected.deviation.rms_m,
                            .unit = "cm"});
  report.figures.push_back({.name = absl::StrCat(name, ": deviation after deformation, rms"),
                            .value = 100 * findings.deformed.deviation.rms_m,
                            .unit = "cm"});
  report.figures.push_back(
      {.name = absl::StrCat(name, ": deviation, built from corrected poses, rms"),
       .value = 100 * from_start_m,
       .unit = "cm"});
  report.figures.push_back({.name = absl::StrCat(name, ": deformed / built from corrected poses"),
                            .value = findings.deformed.deviation.rms_m / from_start_m,
                            .at_most = 1.5});
  report.figures.push_back({.name = absl::StrCat(name, ": the same with submaps of 20 m"),
                            .value = findings.coarser.deviation.rms_m / from_start_m});
  if (findings.deformed.deviation.rms_m > 1.5 * from_start_m) {
    report.notes.push_back(absl::StrFormat(
        "%s misses the aim: odometry and truth turn by %.2f degrees (rms) against each other "
        "within "
        "ten scans, and a rigid piece cannot follow a bend inside it. Pieces of 20 m reach %.2f "
        "times.",
        name,
        TurnDifferenceRms_rad(findings.town.drive.odometry, findings.town.drive.truth, 10) *
            kDegPerRad,
        findings.coarser.deviation.rms_m / from_start_m));
  }
  report.figures.push_back({.name = absl::StrCat(name, ": road error after deformation, rms"),
                            .value = 100 * findings.deformed.error.rms_m,
                            .unit = "cm"});
  report.figures.push_back(
      {.name = absl::StrCat(name, ": cells unlike those of one correction at the end"),
       .value = static_cast<double>(findings.cells_differ),
       .at_most = 0});
}

absl::StatusOr<std::vector<Drive>> Drives(const Settings& settings, Report& report) {
  std::vector<Drive> drives;
  if (const auto dir = TrajectoriesDir(settings)) {
    GEM_ASSIGN_OR_RETURN(Drive ndt, LoadNdtDrive(*dir));
    GEM_ASSIGN_OR_RETURN(Drive kiss, LoadKissIcpDrive(*dir));
    GEM_ASSIGN_OR_RETURN(Drive kinked, LoadKinkedKissIcpDrive(*dir));
    drives = {std::move(ndt), std::move(kiss), std::move(kinked)};
  } else {
    report.skipped.push_back("trajectories of KITTI 00: no `trajectories` in --data");
    drives = {InventedDrive(kInventedScans, 1.0, settings.seed)};
  }
  for (Drive& drive : drives) {
    const auto count = static_cast<std::size_t>(settings.scale * static_cast<double>(drive.size()));
    drive = FirstOf(std::move(drive), std::max<std::size_t>(count, 100));
  }
  return drives;
}

}  // namespace

absl::StatusOr<Report> RunConsistency(const Settings& settings) {
  Report report;
  report.name = "consistency";
  report.title = "Fig. 12 and 14-16: one map from two passes";
  GEM_ASSIGN_OR_RETURN(const std::vector<Drive> drives, Drives(settings, report));
  Table table;
  table.title = "Drives";
  table.columns = {"drive",
                   "scans",
                   "km",
                   "odometry off, m",
                   "vertically, m",
                   "turn over 10 scans, odometry to truth, deg rms",
                   "truth set onto the town's ground, m rms",
                   "corrections"};
  std::string which;
  for (std::size_t i = 0; i < drives.size(); ++i) {
    const double share = 1.0 / static_cast<double>(drives.size());
    GEM_ASSIGN_OR_RETURN(const DriveFindings findings,
                         Investigate(drives[i], settings, static_cast<double>(i) * share, share));
    table.rows.push_back(DriveRow(findings));
    absl::StrAppend(&which, "\n- **", drives[i].name, "**: ", drives[i].description, ".");
    AddFindings(findings, report);
  }
  report.tables.insert(report.tables.begin(), std::move(table));
  if (settings.data_dir && std::filesystem::exists(*settings.data_dir / kRealScans)) {
    GEM_RETURN_IF_ERROR(AddRealConsistency(*settings.data_dir / kRealScans, settings, report));
  } else {
    report.skipped.push_back(absl::StrCat(kRealScans, ": not in --data"));
  }
  report.method = absl::StrCat(
      "Scans are cast in a town grown along the drive, from the place where the sensor truly was; "
      "the robot is told odometry. Map: 12 x 12 m at 0.2 m (the paper's for Fig. 15 and 16), "
      "submaps of 10 m (the default), not merged except where said. A loop is closed when the "
      "truth comes within "
      "5 m of a place that it passed more than 60 s ago, at most once in 50 scans; then the map is "
      "told the corrected poses of all scans so far, and once more at the end. The maps: "
      "*odometry*, left where odometry put it; *deformed* "
      "at every loop, from submaps of 10 m, and *20 m*; *corrected poses*, built from these from "
      "the "
      "start; *merged*, with maintenance at work. *Deviation*: free "
      "cells of G that two passes at least 60 s apart saw, later height less first height. *Road "
      "error*: heights of free cells within 2 m of the way less the town's ground.\n",
      which);
  report.notes.push_back(
      "The ground truth files of KITTI 00 turn by some 0.6 degrees within ten scans against every "
      "SLAM here, while these agree with each other; and they give one street two heights. So "
      "attitudes are taken from SLAM, and places are set onto the town's ground; odometry's and "
      "SLAM's errors against the truth stay what they are at every scan.");
  return report;
}

}  // namespace gem::evaluation
