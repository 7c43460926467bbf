#include "client/evaluation/cyclist.h"

#include <algorithm>
#include <memory>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/datasets/kitti_source.h"
#include "core/base/status_macros.h"
#include "core/local/local_mapper.h"

namespace gem::evaluation {
namespace {

constexpr char kRecording[] = "kitti_raw_0001";

/// Where the rider's body was, one place every two scans, from scan 50 of the 80 to scan 74. Read
/// off the recording: clusters 0.9 to 2 m over the ground that stay in a 0.3 m square for fewer
/// than ten scans. A bollard 0.7 m high stands beside the track: 60 scans before and after the
/// rider see it.
SweptPath RidersPath() {
  SweptPath path;
  path.track_m = {{101.3, -20.6}, {102.5, -20.8}, {103.6, -20.9}, {104.7, -21.0}, {105.6, -21.2},
                  {106.8, -21.4}, {107.9, -21.5}, {108.9, -21.7}, {110.1, -21.8}, {111.1, -21.9},
                  {112.2, -22.1}, {113.2, -22.2}, {114.3, -22.4}};
  path.standing_m = {104.8, -21.6};
  return path;
}
/// He has left the path behind him by then.
constexpr std::size_t kRidingScan = 63;

double DistanceToSegment(const Eigen::Vector2d& place_m, const Eigen::Vector2d& from_m,
                         const Eigen::Vector2d& to_m) {
  const Eigen::Vector2d way_m = to_m - from_m;
  const double along = std::clamp((place_m - from_m).dot(way_m) / way_m.squaredNorm(), 0.0, 1.0);
  return (place_m - from_m - along * way_m).norm();
}

/// After each scan of the recording.
absl::StatusOr<std::vector<SweptCells>> Replay(const std::string& dir, float clear_sigmas) {
  GEM_ASSIGN_OR_RETURN(
      const auto source,
      KittiSource::Open(
          {.dir = dir, .poses = {}, .corrected = {}, .pose_frame = KittiPoseFrame::kAutomatic}));
  LocalMapOptions options;
  options.side_m = 40;
  options.clear_sigmas = clear_sigmas;
  GEM_ASSIGN_OR_RETURN(const auto mapper, MakeLocalMapper(LocalBackend::kCpu, options));
  const SweptPath path = RidersPath();
  SourceScan from;
  Scan scan;
  scan.T_B_S = source->T_B_S();
  scan.noise = source->noise();
  std::vector<EvictedCell> evicted;
  LocalMap map;
  std::vector<SweptCells> counts;
  while (true) {
    GEM_ASSIGN_OR_RETURN(const bool has_scan, source->Next(from));
    if (!has_scan) return counts;
    ++scan.seq;
    scan.stamp_ns = from.stamp_ns;
    scan.T_O_B = from.T_O_B;
    scan.points = from.points;
    evicted.clear();
    mapper->FuseScan(scan, evicted);
    mapper->CopyTo(map);
    counts.push_back(CountSwept(map, path));
  }
}

Series SeriesOf(const char* name, const std::vector<SweptCells>& counts, int SweptCells::*count) {
  Series series{.name = name};
  for (std::size_t i = 0; i < counts.size(); ++i) {
    series.x.push_back(static_cast<double>(i + 1));
    series.y.push_back(counts[i].*count);
  }
  return series;
}

std::vector<std::string> Row(const std::string& when, const SweptCells& cells) {
  return {when, absl::StrCat(cells.known), absl::StrCat(cells.obstacles), absl::StrCat(cells.trail),
          absl::StrCat(cells.standing)};
}

}  // namespace

bool SweptPath::Covers(const Eigen::Vector2d& place_m) const {
  for (std::size_t i = 1; i < track_m.size(); ++i)
    if (DistanceToSegment(place_m, track_m[i - 1], track_m[i]) <= half_width_m) return true;
  return false;
}

SweptCells CountSwept(const LocalMap& map, const SweptPath& path) {
  SweptCells count;
  const CellRect rect = map.rect();
  const auto cell_size_m = static_cast<double>(map.cell_size_m);
  for (std::int32_t y = rect.min.y; y < rect.max.y; ++y) {
    for (std::int32_t x = rect.min.x; x < rect.max.x; ++x) {
      const std::size_t index = map.IndexOf({x, y});
      const CellBelief cell = map.BeliefAt(index);
      const Eigen::Vector2d center_m(CenterOf(x, cell_size_m), CenterOf(y, cell_size_m));
      if (!cell.known() || !path.Covers(center_m)) continue;
      ++count.known;
      if (cell.annotated() && cell.traversability > map.traversability_free) continue;
      ++count.obstacles;
      if (static_cast<double>(cell.elevation_m) <= path.elevation_m_min) continue;
      const bool stands = (center_m - path.standing_m).norm() < path.standing_reach_m;
      ++(stands ? count.standing : count.trail);
    }
  }
  return count;
}

absl::Status AddCyclist(const Settings& settings, Report& report) {
  if (!settings.data_dir.has_value()) {
    report.skipped.push_back(absl::StrCat(kRecording, ": no --data"));
    return absl::OkStatus();
  }
  const std::string dir = *settings.data_dir / kRecording;
  const LocalMapOptions options;
  GEM_ASSIGN_OR_RETURN(const std::vector<SweptCells> cleared, Replay(dir, options.clear_sigmas));
  // No ray is so far below anything but the head of the rider.
  constexpr float kNever = 100;
  GEM_ASSIGN_OR_RETURN(const std::vector<SweptCells> uncleared, Replay(dir, kNever));
  if (cleared.size() <= kRidingScan)
    return absl::InvalidArgumentError(
        absl::StrCat(dir, " has ", cleared.size(), " scans, want ", kRidingScan + 1, " or more"));
  const SweptCells riding = cleared[kRidingScan], after = cleared.back();
  const SweptCells control = uncleared.back();
  report.figures.push_back({.name = "cyclist: obstacle cells while he rides there",
                            .value = static_cast<double>(riding.trail),
                            .unit = "cells",
                            .at_least = 5});
  report.figures.push_back({.name = "cyclist: obstacle cells after he left",
                            .value = static_cast<double>(after.trail),
                            .unit = "cells",
                            .at_most = 0});
  report.figures.push_back({.name = "cyclist: the same without clearing",
                            .value = static_cast<double>(control.trail),
                            .unit = "cells"});
  report.figures.push_back({.name = "cyclist: cells left of the bollard beside his path",
                            .value = static_cast<double>(after.standing),
                            .unit = "cells",
                            .at_least = 1});
  report.tables.push_back(
      {.title = "The cyclist's swept path in the local map (40x40 m, 0.2 m), cells",
       .columns = {"when", "known", "obstacles", "of them trail", "of them bollard"},
       .rows = {Row(absl::StrFormat("scan %d, while he rides there", kRidingScan + 1), riding),
                Row(absl::StrFormat("scan %d, after he left", cleared.size()), after),
                Row("the same, without clearing", control)}});
  report.plots.push_back(
      {.name = "cyclist",
       .title = "A cyclist rides past (kitti_raw_0001)",
       .x_label = "scan",
       .y_label = "obstacle cells on his path",
       .series = {SeriesOf("cleared", cleared, &SweptCells::trail),
                  SeriesOf("never cleared", uncleared, &SweptCells::trail),
                  SeriesOf("bollard, cleared", cleared, &SweptCells::standing)}});
  return absl::OkStatus();
}

}  // namespace gem::evaluation
