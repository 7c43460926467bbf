#include "client/evaluation/constant_time.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/evaluation/submap_run.h"
#include "client/evaluation/town_drive.h"
#include "core/base/status_macros.h"

namespace gem::evaluation {
namespace {

constexpr std::size_t kEnds = 500;  // scans at the beginning and at the end that are compared
constexpr std::size_t kBin = 50;    // scans a point of a plot
constexpr std::size_t kCorrections = 20;
constexpr double kAllowedChange = 0.1;

struct Setup {
  float side_m = 8;
  float cell_m = 0.2f;
  std::string Name() const { return absl::StrFormat("%g m at %g m", side_m, cell_m); }
};
constexpr std::array<Setup, 4> kSetups = {{{8, 0.2f}, {16, 0.2f}, {8, 0.1f}, {16, 0.1f}}};

/// Of one setup, by scan.
struct Costs {
  std::vector<double> local_ms;
  std::vector<double> submap_ms;  ///< the local mapper and the submap building
  std::vector<double> points;     ///< in the window
};

/// Of one setup, by correction.
struct CorrectionCosts {
  std::vector<double> submaps;
  std::vector<double> deform_ms;
  std::vector<double> merge_ms;
  std::vector<double> compose_ms;
};

struct SetupFindings {
  Setup setup;
  Costs drive;
  double aged_to_fresh = 0;  ///< time for the same scans
  double dense_ms = 0;       ///< a scan of an HDL-64's density
  CorrectionCosts corrections;
};

using Recorders = std::array<std::unique_ptr<SubmapRecorder>, kSetups.size()>;

absl::StatusOr<Recorders> MakeRecorders() {
  Recorders recorders;
  for (std::size_t i = 0; i < kSetups.size(); ++i) {
    LocalMapOptions local;
    local.side_m = kSetups[i].side_m;
    local.cell_size_m = kSetups[i].cell_m;
    GEM_ASSIGN_OR_RETURN(recorders[i],
                         SubmapRecorder::Make(local, GlobalMapOptions().submap_length_m));
  }
  return recorders;
}

void Append(const SubmapRecorder::Cost& cost, Costs& costs) {
  const double local_ms = 1e3 * cost.local.seconds.total();
  costs.local_ms.push_back(local_ms);
  costs.submap_ms.push_back(local_ms + 1e3 * cost.submap_s);
  costs.points.push_back(static_cast<double>(cost.local.points_fused + cost.local.points_gated));
}

CastOptions Casting(const Settings& settings) {
  return {.lidar = TownLidar(500), .threads = settings.threads, .seed = settings.seed};
}

/// The first scans once more, to the mappers that have come all the way and to new ones, by turns:
/// whatever else the machine does meets both alike.
absl::StatusOr<std::array<double, kSetups.size()>> AgedToFresh(const TownDrive& town,
                                                               const Settings& settings,
                                                               const Recorders& aged) {
  GEM_ASSIGN_OR_RETURN(const Recorders fresh, MakeRecorders());
  const Drive& drive = town.drive;
  const std::int64_t later_ns = drive.stamps_ns.back() + 1'000'000'000;
  CastOptions casting = Casting(settings);
  casting.end = std::min(kEnds, drive.size());
  std::array<std::vector<double>, kSetups.size()> ratios;
  CastScans(town, casting, [&](std::size_t i, std::span<const ScanPoint> points) {
    for (std::size_t s = 0; s < kSetups.size(); ++s) {
      const auto seconds = [&](SubmapRecorder& recorder, std::int64_t stamp_ns) {
        const SubmapRecorder::Cost cost = recorder.Fuse(stamp_ns, drive.odometry[i], points);
        return cost.local.seconds.total() + cost.submap_s;
      };
      // The second of two finds the points in the cache: each is second as often as the other.
      double aged_s = 0, fresh_s = 0;
      if (i % 2 == 0) aged_s = seconds(*aged[s], later_ns + drive.stamps_ns[i]);
      fresh_s = seconds(*fresh[s], drive.stamps_ns[i]);
      if (i % 2 == 1) aged_s = seconds(*aged[s], later_ns + drive.stamps_ns[i]);
      ratios[s].push_back(aged_s / fresh_s);
    }
  });
  std::array<double, kSetups.size()> medians{};
  for (std::size_t s = 0; s < kSetups.size(); ++s) {
    // The median of each order, so that the middle is not one of them.
    std::vector<double> even, odd;
    for (std::size_t i = 0; i < ratios[s].size(); ++i)
      (i % 2 == 0 ? even : odd).push_back(ratios[s][i]);
    medians[s] = std::sqrt(MedianOf(even, 0, even.size()) * MedianOf(odd, 0, odd.size()));
  }
  return medians;
}

/// Median time a scan with the local mapper and submap building, ms, for scans as dense as an
/// HDL-64's: what a point costs counts there as much as what a cell costs.
absl::StatusOr<std::array<double, kSetups.size()>> DenseMedians(const TownDrive& town,
                                                                const Settings& settings) {
  constexpr std::size_t kScans = 120;
  constexpr std::size_t kWarmUp = 20;  // until the windows are full
  GEM_ASSIGN_OR_RETURN(const Recorders recorders, MakeRecorders());
  CastOptions casting = Casting(settings);
  casting.lidar.azimuths = 1900;
  casting.lidar.range_m_max = 60;
  casting.begin = town.drive.size() / 2;
  casting.end = std::min(casting.begin + kScans, town.drive.size());
  std::array<Costs, kSetups.size()> costs;
  CastScans(town, casting, [&](std::size_t i, std::span<const ScanPoint> points) {
    for (std::size_t s = 0; s < kSetups.size(); ++s)
      Append(recorders[s]->Fuse(town.drive.stamps_ns[i], town.drive.odometry[i], points), costs[s]);
  });
  std::array<double, kSetups.size()> medians{};
  for (std::size_t s = 0; s < kSetups.size(); ++s)
    medians[s] = MedianOf(costs[s].submap_ms, kWarmUp, kScans);
  return medians;
}

/// A correction of all scans so far, a little more than the last one, so that it moves every
/// submap, as an optimisation of the whole graph does.
CorrectedTrajectory CorrectionInPart(const TownDrive& town, const SubmapRun& run, std::size_t count,
                                     double share) {
  const Drive& drive = town.drive;
  const Pose<Global, Odom> T_G_O = drive.corrected.front() * drive.odometry.front().Inverse();
  CorrectedTrajectory correction;
  for (std::size_t i = 0; i < count; ++i)
    correction.push_back({run.odometry[i].stamp_ns,
                          Interpolate(T_G_O * drive.odometry[i], drive.corrected[i], share)});
  return correction;
}

absl::StatusOr<CorrectionCosts> CostsOfCorrections(const TownDrive& town, const SubmapRun& run,
                                                   const Settings& settings) {
  GlobalMapOptions options;
  options.compose_threads = settings.threads;
  const Drive& drive = town.drive;
  MapReplay map(run, options, drive.corrected.front() * drive.odometry.front().Inverse());
  CorrectionCosts costs;
  for (std::size_t k = 1; k <= kCorrections; ++k) {
    const std::size_t count = drive.size() * k / kCorrections;
    map.TellUntil(count - 1);
    map.Commit();
    const double share = static_cast<double>(k) / static_cast<double>(kCorrections);
    GEM_RETURN_IF_ERROR(map.Correct(CorrectionInPart(town, run, count, share)));
    const CommitReport report = map.Commit();
    costs.submaps.push_back(static_cast<double>(map.snapshot().submaps.size()));
    costs.deform_ms.push_back(1e3 * report.seconds.deform);
    costs.merge_ms.push_back(1e3 * report.seconds.merge);
    costs.compose_ms.push_back(1e3 * report.seconds.compose);
  }
  return costs;
}

Series Binned(const std::string& name, const std::vector<double>& values) {
  Series series{.name = name};
  for (std::size_t begin = 0; begin < values.size(); begin += kBin) {
    series.x.push_back(static_cast<double>(begin + kBin / 2));
    series.y.push_back(MedianOf(values, begin, kBin));
  }
  return series;
}

/// Last over first; `per` divides each scan's time.
double Change(const std::vector<double>& ms, const std::vector<double>& per) {
  std::vector<double> values = ms;
  for (std::size_t i = 0; i < values.size(); ++i) values[i] /= std::max(per[i], 1.0);
  const std::size_t ends = std::min(kEnds, values.size() / 2);
  return MedianOf(values, values.size() - ends, ends) / MedianOf(values, 0, ends);
}

void AddPlots(const std::vector<SetupFindings>& all, Report& report) {
  Plot local{.name = "local", .title = "Fig. 6, left: local dense mapper"};
  Plot submap{.name = "submap", .title = "Fig. 6, right, and 8: with submap building"};
  Plot deform{.name = "deform", .title = "Fig. 7: deforming (new poses of all submaps)"};
  Plot compose{.name = "compose", .title = "Fig. 7: composing the tiles anew"};
  for (const SetupFindings& findings : all) {
    const std::string name = findings.setup.Name();
    local.series.push_back(Binned(name, findings.drive.local_ms));
    submap.series.push_back(Binned(name, findings.drive.submap_ms));
    const CorrectionCosts& costs = findings.corrections;
    deform.series.push_back({name, costs.submaps, costs.deform_ms});
    compose.series.push_back({name, costs.submaps, costs.compose_ms});
  }
  for (Plot* plot : {&local, &submap}) {
    plot->x_label = "scan";
    plot->y_label = absl::StrCat("ms a scan, median of ", kBin);
  }
  for (Plot* plot : {&deform, &compose}) {
    plot->x_label = "submaps in the map";
    plot->y_label = "ms a correction";
  }
  report.plots = {local, submap, deform, compose};
}

std::string Ms(double ms) { return absl::StrFormat("%.3f", ms); }
std::string Ratio(double ratio) { return absl::StrFormat("%.3f", ratio); }

void AddTables(const std::vector<SetupFindings>& all, Report& report) {
  Table scans{.title = "Time a scan, medians"};
  scans.columns = {"map",
                   "local mapper, ms",
                   "with submap building, ms",
                   "of 64 x 1900 beams, ms",
                   "points in the window",
                   "last 500 / first 500 scans",
                   "the same a point in the window",
                   "same scans, after the drive / new"};
  Table corrections{.title = "The last correction, which moves every submap"};
  corrections.columns = {"map", "submaps", "deform, ms", "merge, ms", "compose, ms"};
  for (const SetupFindings& findings : all) {
    const Costs& drive = findings.drive;
    const std::size_t count = drive.local_ms.size();
    const std::vector<double> ones(count, 1.0);
    scans.rows.push_back({findings.setup.Name(), Ms(MedianOf(drive.local_ms, 0, count)),
                          Ms(MedianOf(drive.submap_ms, 0, count)), Ms(findings.dense_ms),
                          absl::StrFormat("%.0f", MedianOf(drive.points, 0, count)),
                          Ratio(Change(drive.submap_ms, ones)),
                          Ratio(Change(drive.submap_ms, drive.points)),
                          Ratio(findings.aged_to_fresh)});
    const CorrectionCosts& costs = findings.corrections;
    corrections.rows.push_back(
        {findings.setup.Name(), absl::StrFormat("%.0f", costs.submaps.back()),
         Ms(costs.deform_ms.back()), Ms(costs.merge_ms.back()), Ms(costs.compose_ms.back())});
  }
  report.tables = {scans, corrections};
}

void AddFigures(const std::vector<SetupFindings>& all, Report& report) {
  double raw = 0, aged = 0;
  for (const SetupFindings& findings : all) {
    const std::vector<double> ones(findings.drive.submap_ms.size(), 1.0);
    raw = std::max(raw, std::abs(Change(findings.drive.submap_ms, ones) - 1));
    aged = std::max(aged, std::abs(findings.aged_to_fresh - 1));
  }
  const CorrectionCosts& last = all.front().corrections;
  report.figures = {
      {.name = "time a scan, same scans after the drive against new mappers: largest change",
       .value = 100 * aged,
       .unit = "%",
       .at_most = 100 * kAllowedChange},
      {.name = "time a scan, last 500 scans against first 500: largest change",
       .value = 100 * raw,
       .unit = "%",
       .at_most = 100 * kAllowedChange},
      {.name = "time a scan of 64 x 1900 beams, 8 m at 0.2 m, median",
       .value = all[0].dense_ms,
       .unit = "ms"},
      {.name = "four times the cells by side, 16 m / 8 m at 0.2 m",
       .value = all[1].dense_ms / all[0].dense_ms,
       .at_most = 2,
       .paper = 2},
      {.name = "four times the cells by resolution, 0.1 m / 0.2 m at 8 m",
       .value = all[2].dense_ms / all[0].dense_ms,
       .at_most = 2,
       .paper = 2},
      {.name = "correction that moves the whole map, 8 m at 0.2 m, last",
       .value = last.deform_ms.back() + last.merge_ms.back() + last.compose_ms.back(),
       .unit = "ms",
       .at_most = 100}};
}

absl::StatusOr<Drive> DriveFor(const Settings& settings, Report& report) {
  Drive drive;
  if (const auto dir = TrajectoriesDir(settings)) {
    GEM_ASSIGN_OR_RETURN(drive, LoadKissIcpDrive(*dir));
  } else {
    report.skipped.push_back("trajectories of KITTI 00: no `trajectories` in --data");
    drive = InventedDrive(4541, 1.0, settings.seed);
  }
  const auto count = static_cast<std::size_t>(settings.scale * static_cast<double>(drive.size()));
  return FirstOf(std::move(drive), std::max<std::size_t>(count, 100));
}

}  // namespace

double MedianOf(const std::vector<double>& values, std::size_t begin, std::size_t count) {
  begin = std::min(begin, values.size());
  const auto first = values.begin() + static_cast<std::ptrdiff_t>(begin);
  std::vector<double> part(
      first, first + static_cast<std::ptrdiff_t>(std::min(count, values.size() - begin)));
  if (part.empty()) return 0;
  const auto middle = part.begin() + static_cast<std::ptrdiff_t>(part.size() / 2);
  std::nth_element(part.begin(), middle, part.end());
  return *middle;
}

absl::StatusOr<Report> RunConstantTime(const Settings& settings) {
  Report report;
  report.name = "constant_time";
  report.title = "Fig. 6-8: time over a long drive";
  GEM_ASSIGN_OR_RETURN(Drive drive, DriveFor(settings, report));
  const TownDrive town = BuildTownDrive(std::move(drive), settings.seed);
  GEM_ASSIGN_OR_RETURN(const Recorders recorders, MakeRecorders());
  std::vector<SetupFindings> all;
  all.reserve(kSetups.size());
  for (const Setup& setup : kSetups) all.push_back({setup, {}, 0, 0, {}});
  CastScans(town, Casting(settings), [&](std::size_t i, std::span<const ScanPoint> points) {
    for (std::size_t s = 0; s < kSetups.size(); ++s)
      Append(recorders[s]->Fuse(town.drive.stamps_ns[i], town.drive.odometry[i], points),
             all[s].drive);
    if (i % 64 == 0)
      settings.progress("scans",
                        0.8 * static_cast<double>(i) / static_cast<double>(town.drive.size()));
  });
  for (std::size_t s = 0; s < kSetups.size(); ++s) {
    settings.progress("corrections", 0.8 + 0.03 * static_cast<double>(s));
    GEM_ASSIGN_OR_RETURN(all[s].corrections,
                         CostsOfCorrections(town, recorders[s]->run(), settings));
  }
  GEM_ASSIGN_OR_RETURN(const auto aged_to_fresh, AgedToFresh(town, settings, recorders));
  GEM_ASSIGN_OR_RETURN(const auto dense_ms, DenseMedians(town, settings));
  for (std::size_t s = 0; s < kSetups.size(); ++s) {
    all[s].aged_to_fresh = aged_to_fresh[s];
    all[s].dense_ms = dense_ms[s];
  }

  AddPlots(all, report);
  AddTables(all, report);
  AddFigures(all, report);
  report.method = absl::StrCat(
      "Scans are cast in a town grown along ", town.drive.description,
      ". Each scan (64 x 500 "
      "beams, up to 25 m) is cast once, ahead of the mappers, and goes through four of them, one "
      "after the other, on one thread; odometry drifts as recorded. Street scenes differ, so the "
      "first ",
      kEnds,
      " scans are cast again after the drive and go to the mappers that have driven and to "
      "new ones by turns: what differs is age, not content. A hundred scans from the middle are "
      "cast "
      "as dense as an HDL-64's (64 x 1900 beams, 60 m), too. Then ",
      kCorrections,
      " times the map of all scans so far is corrected a little further, so that "
      "every submap moves. Octomap, C-blox, ElasticFusion and Surfel-Mapping of Fig. 8 are not "
      "run here.");
  return report;
}

}  // namespace gem::evaluation
