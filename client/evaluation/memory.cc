#include "client/evaluation/memory.h"

#include <algorithm>
#include <array>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/evaluation/revisits.h"
#include "client/evaluation/submap_run.h"
#include "client/evaluation/town_drive.h"
#include "core/base/parallel_for.h"
#include "core/base/status_macros.h"

namespace gem::evaluation {
namespace {

constexpr std::size_t kCommitScans = 50;
constexpr int kAzimuths = 250;
// The paper: "multiple closed loops from frame 3300 to 4000".
constexpr std::size_t kRevisitBegin = 3300;
constexpr std::size_t kRevisitEnd = 4000;
constexpr std::size_t kBlockScans = 6000;
constexpr double kBlockSpacing_m = 0.8;
constexpr double kBlockGap_s = 15;  // a round takes 24 s

struct Setup {
  float side_m = 8;
  float cell_m = 0.2f;
  std::string Name() const { return absl::StrFormat("%g m at %g m", side_m, cell_m); }
};
constexpr std::array<Setup, 4> kSetups = {{{8, 0.2f}, {16, 0.2f}, {8, 0.1f}, {16, 0.1f}}};

/// What the map holds, by commit.
struct Growth {
  std::vector<double> scans;
  std::vector<double> points;
  std::vector<double> bytes;
  std::vector<double> submaps;
  std::vector<double> ground;  ///< known cells of the published map: no ground counts twice

  /// Points at the last commit up to this scan; 0 before the first.
  double PointsAt(std::size_t scan) const {
    const auto after = std::upper_bound(scans.begin(), scans.end(), static_cast<double>(scan));
    return after == scans.begin() ? 0 : points[static_cast<std::size_t>(after - scans.begin()) - 1];
  }
  /// Percent of the points at `begin`.
  double GrowthBetween(std::size_t begin, std::size_t end) const {
    const double before = PointsAt(begin);
    return before > 0 ? 100 * (PointsAt(end) / before - 1) : 0;
  }
  /// Percent, of the second half of the commits.
  double GroundGrowthInSecondHalf() const {
    return ground.empty() ? 0 : 100 * (ground.back() / ground[(ground.size() - 1) / 2] - 1);
  }
  double PointsPerGroundCell() const {
    return ground.empty() || ground.back() == 0 ? 0 : points.back() / ground.back();
  }
};

using Recorders = std::vector<std::unique_ptr<SubmapRecorder>>;

absl::StatusOr<Recorders> MapScans(const TownDrive& town, const std::vector<Setup>& setups,
                                   const Settings& settings, double begin, double share) {
  Recorders recorders;
  for (const Setup& setup : setups) {
    LocalMapOptions local;
    local.side_m = setup.side_m;
    local.cell_size_m = setup.cell_m;
    GEM_ASSIGN_OR_RETURN(auto recorder,
                         SubmapRecorder::Make(local, GlobalMapOptions().submap_length_m));
    recorders.push_back(std::move(recorder));
  }
  const Drive& drive = town.drive;
  CastScans(town,
            {.lidar = TownLidar(kAzimuths), .threads = settings.threads, .seed = settings.seed},
            [&](std::size_t i, std::span<const ScanPoint> points) {
              ParallelFor(recorders.size(), settings.threads, [&](std::size_t s) {
                recorders[s]->Fuse(drive.stamps_ns[i], drive.odometry[i], points);
              });
              if (i % 64 == 0)
                settings.progress(drive.name, begin + share * static_cast<double>(i) /
                                                          static_cast<double>(drive.size()));
            });
  for (auto& recorder : recorders) recorder->End();
  return recorders;
}

double GroundCells(const MapSnapshot& map) {
  std::size_t count = 0;
  for (const auto& [index, tile] : map.tiles)
    count += static_cast<std::size_t>(std::count_if(tile->cells.begin(), tile->cells.end(),
                                                    [](const CellBelief& c) { return c.known(); }));
  return static_cast<double>(count);
}

/// The longest run of scans [first, second) that each come near a place of more than 60 s ago: on
/// streets that were driven before.
std::pair<std::size_t, std::size_t> LongestRevisit(const Drive& drive) {
  const std::vector<std::size_t> closures =
      LoopClosures(drive.truth, drive.stamps_ns, {.scans_between = 1});
  std::pair<std::size_t, std::size_t> longest{0, 0};
  std::size_t begin = 0;
  for (std::size_t i = 0; i < closures.size(); ++i) {
    if (i > 0 && closures[i] != closures[i - 1] + 1) begin = i;
    if (i - begin >= longest.second - longest.first) longest = {closures[begin], closures[i] + 1};
  }
  return longest;
}

/// The map over the drive, corrected at every loop.
absl::StatusOr<Growth> Grow(const TownDrive& town, const SubmapRun& run, const LoopRule& loops,
                            bool merge, const Settings& settings) {
  GlobalMapOptions options;
  options.compose_threads = settings.threads;
  if (!merge) options.merge_overlap_min = 1000;
  const Drive& drive = town.drive;
  const std::vector<std::size_t> closures = LoopClosures(drive.truth, drive.stamps_ns, loops);
  auto closure = closures.begin();
  MapReplay map(run, options, drive.corrected.front() * drive.odometry.front().Inverse());
  Growth growth;
  for (std::size_t scan = kCommitScans - 1; scan < drive.size(); scan += kCommitScans) {
    map.TellUntil(scan);
    bool closed = false;
    for (; closure != closures.end() && *closure <= scan; ++closure) closed = true;
    if (closed) GEM_RETURN_IF_ERROR(map.Correct(CorrectionOf(run, drive.corrected, scan + 1)));
    map.Commit();
    growth.scans.push_back(static_cast<double>(scan + 1));
    growth.points.push_back(static_cast<double>(map.snapshot().num_points));
    growth.bytes.push_back(static_cast<double>(map.snapshot().submap_bytes));
    growth.submaps.push_back(static_cast<double>(map.snapshot().submaps.size()));
    growth.ground.push_back(GroundCells(map.snapshot()));
  }
  return growth;
}

struct SetupFindings {
  Setup setup;
  Growth merged;
  Growth unmerged;
};

absl::StatusOr<std::vector<SetupFindings>> Investigate(const TownDrive& town,
                                                       const std::vector<Setup>& setups,
                                                       const LoopRule& loops,
                                                       const Settings& settings, double begin,
                                                       double share) {
  GEM_ASSIGN_OR_RETURN(const Recorders recorders,
                       MapScans(town, setups, settings, begin, 0.8 * share));
  std::vector<SetupFindings> all;
  for (std::size_t s = 0; s < setups.size(); ++s) {
    SetupFindings findings{setups[s], {}, {}};
    GEM_ASSIGN_OR_RETURN(findings.merged, Grow(town, recorders[s]->run(), loops, true, settings));
    GEM_ASSIGN_OR_RETURN(findings.unmerged,
                         Grow(town, recorders[s]->run(), loops, false, settings));
    all.push_back(std::move(findings));
  }
  return all;
}

Plot PointsPlot(std::string name, std::string title, const std::vector<SetupFindings>& all) {
  Plot plot{.name = std::move(name), .title = std::move(title)};
  plot.x_label = "scan";
  plot.y_label = "stored points, thousand";
  const auto add = [&plot](const std::string& series_name, const Growth& growth) {
    Series series{.name = series_name, .x = growth.scans, .y = growth.points};
    for (double& points : series.y) points *= 1e-3;
    plot.series.push_back(std::move(series));
  };
  for (const SetupFindings& findings : all) {
    add(findings.setup.Name(), findings.merged);
    if (all.size() <= 2) add(findings.setup.Name() + ", not merged", findings.unmerged);
  }
  return plot;
}

double BytesPerPoint(const Growth& growth) {
  return growth.points.back() > 0 ? growth.bytes.back() / growth.points.back() : 0;
}

Table DriveTable(const std::vector<SetupFindings>& all, bool has_stretch) {
  Table table{.title = "At the end of the drive"};
  table.columns = {"map",
                   "points",
                   "points, not merged",
                   "MB",
                   "submaps",
                   "bytes per point",
                   "points per cell of ground",
                   "growth in scans 3300-4000, %",
                   "the same, not merged, %"};
  const auto percent = [&](const Growth& growth) {
    return has_stretch ? absl::StrFormat("%.1f", growth.GrowthBetween(kRevisitBegin, kRevisitEnd))
                       : std::string("-");
  };
  for (const SetupFindings& findings : all) {
    const Growth& merged = findings.merged;
    table.rows.push_back({findings.setup.Name(), absl::StrFormat("%.0f", merged.points.back()),
                          absl::StrFormat("%.0f", findings.unmerged.points.back()),
                          absl::StrFormat("%.1f", merged.bytes.back() * 1e-6),
                          absl::StrFormat("%.0f", merged.submaps.back()),
                          absl::StrFormat("%.1f", BytesPerPoint(merged)),
                          absl::StrFormat("%.3f", merged.PointsPerGroundCell()), percent(merged),
                          percent(findings.unmerged)});
  }
  return table;
}

Table BlockTable(const SetupFindings& findings) {
  Table table{.title = "Round one block, 8 m at 0.2 m"};
  table.columns = {"scan", "points", "cells of ground", "submaps", "points, not merged"};
  const Growth& merged = findings.merged;
  const std::size_t step = std::max<std::size_t>(merged.scans.size() / 8, 1);
  for (std::size_t i = step - 1; i < merged.scans.size(); i += step)
    table.rows.push_back(
        {absl::StrFormat("%.0f", merged.scans[i]), absl::StrFormat("%.0f", merged.points[i]),
         absl::StrFormat("%.0f", merged.ground[i]), absl::StrFormat("%.0f", merged.submaps[i]),
         absl::StrFormat("%.0f", findings.unmerged.points[i])});
  return table;
}

/// Whether the drive is KITTI 00, whole: only then frames 3300 to 4000 are the paper's.
absl::StatusOr<std::pair<Drive, bool>> DriveFor(const Settings& settings, Report& report) {
  Drive drive;
  bool is_kitti = false;
  if (const auto dir = TrajectoriesDir(settings)) {
    GEM_ASSIGN_OR_RETURN(drive, LoadKissIcpDrive(*dir));
    is_kitti = true;
  } else {
    report.skipped.push_back("trajectories of KITTI 00: no `trajectories` in --data");
    drive = InventedDrive(4541, 1.0, settings.seed);
  }
  const auto count = static_cast<std::size_t>(settings.scale * static_cast<double>(drive.size()));
  drive = FirstOf(std::move(drive), std::max<std::size_t>(count, 100));
  is_kitti = is_kitti && drive.size() >= kRevisitEnd;
  if (!is_kitti) report.skipped.push_back("scans 3300-4000 of Fig. 17: the drive is another");
  return std::make_pair(std::move(drive), is_kitti);
}

void AddDriveFigures(const std::vector<SetupFindings>& drive, const Drive& way, bool is_kitti,
                     Report& report) {
  // A cell enters the map when its submap is finished: after 10 m and half a window.
  constexpr std::size_t kLag = 50;
  const auto [begin, end] = LongestRevisit(way);
  double bytes_max = 0, growth_max = 0, stretch_max = 0;
  for (const SetupFindings& findings : drive) {
    bytes_max = std::max(bytes_max, BytesPerPoint(findings.merged));
    growth_max = std::max(growth_max, findings.merged.GrowthBetween(begin + kLag, end));
    stretch_max = std::max(stretch_max, findings.merged.GrowthBetween(kRevisitBegin, kRevisitEnd));
  }
  report.figures.push_back({.name = "bytes per stored point, everything included, most of all maps",
                            .value = bytes_max,
                            .at_most = 40});
  if (begin + 2 * kLag < end) {
    const std::string scans = absl::StrCat("scans ", begin + kLag, "-", end);
    report.figures.push_back(
        {.name = absl::StrCat("points while no street is new, ", scans, ", most of all maps"),
         .value = growth_max,
         .unit = "%",
         .at_most = 2});
    report.figures.push_back({.name = "the same without maintenance, 8 m at 0.2 m",
                              .value = drive.front().unmerged.GrowthBetween(begin + kLag, end),
                              .unit = "%"});
  }
  if (is_kitti)
    report.figures.push_back(
        {.name = "points in scans 3300-4000, most of all maps", .value = stretch_max, .unit = "%"});
}

void AddBlockFigures(const SetupFindings& block, Report& report) {
  const auto scans = static_cast<std::size_t>(block.merged.scans.back());
  report.figures.push_back({.name = "round one block, points in the second half of the drive",
                            .value = block.merged.GrowthBetween(scans / 2, scans),
                            .unit = "%",
                            .at_most = 2});
  report.figures.push_back({.name = "round one block, ground seen in the second half",
                            .value = block.merged.GroundGrowthInSecondHalf(),
                            .unit = "%"});
  report.notes.push_back(absl::StrFormat(
      "Storage follows the ground seen: round the block the map stores %.3f points for each cell "
      "of "
      "ground, and in the second half both grow alike (%.1f %% and %.1f %%). Ground is still seen "
      "anew because the robot weaves, and because the square window keeps the axes of odometry, "
      "which turn against the street.",
      block.merged.PointsPerGroundCell(), block.merged.GrowthBetween(scans / 2, scans),
      block.merged.GroundGrowthInSecondHalf()));
  report.figures.push_back({.name = "round one block, stored points per cell of ground",
                            .value = block.merged.PointsPerGroundCell(),
                            .at_most = 1.1});
  report.figures.push_back(
      {.name = "the same without maintenance", .value = block.unmerged.PointsPerGroundCell()});
}

}  // namespace

absl::StatusOr<Report> RunMemory(const Settings& settings) {
  Report report;
  report.name = "memory";
  report.title = "Fig. 17 and 18: storage over a drive";
  GEM_ASSIGN_OR_RETURN(auto chosen, DriveFor(settings, report));
  const bool is_kitti = chosen.second;
  const TownDrive town = BuildTownDrive(std::move(chosen.first), settings.seed);
  GEM_ASSIGN_OR_RETURN(const std::vector<SetupFindings> drive,
                       Investigate(town, {kSetups.begin(), kSetups.end()}, {}, settings, 0, 0.7));

  const auto block_scans = std::max<std::size_t>(
      500, static_cast<std::size_t>(settings.scale * static_cast<double>(kBlockScans)));
  const TownDrive block = BuildTownDrive(
      RoundTheBlock(block_scans, kBlockSpacing_m, 1.0, settings.seed), settings.seed);
  GEM_ASSIGN_OR_RETURN(
      const std::vector<SetupFindings> round,
      Investigate(block, {kSetups.front()}, {.gap_s = kBlockGap_s}, settings, 0.7, 0.3));

  report.plots = {PointsPlot("points", "Fig. 17: stored points over the drive", drive),
                  PointsPlot("points_not_merged", "With and without maintenance, 8 m at 0.2 m",
                             {drive.front()}),
                  PointsPlot("block", "Fig. 18: round one block", round)};
  report.tables = {DriveTable(drive, is_kitti), BlockTable(round.front())};
  AddDriveFigures(drive, town.drive, is_kitti, report);
  AddBlockFigures(round.front(), report);
  report.method = absl::StrFormat(
      "Scans are cast in a town grown along %s. The robot is told odometry; the map commits every "
      "%d scans and is corrected where the truth comes within 5 m of a place of more than 60 s "
      "ago (on the block: 15 s). *Points* are the cells of all finished submaps, *bytes* all that "
      "they occupy; *cells of ground* are the known cells of the published map. The block: %s, %d "
      "scans, %.1f km.",
      town.drive.description, static_cast<int>(kCommitScans), block.drive.description,
      static_cast<int>(block.drive.size()), LengthOf(block.drive) / 1000);
  return report;
}

}  // namespace gem::evaluation
