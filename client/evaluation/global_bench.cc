#include "client/evaluation/global_bench.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "absl/strings/str_format.h"
#include "client/evaluation/bench_range.h"
#include "client/evaluation/made_up_drive.h"
#include "core/base/cancel_token.h"
#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/base/stopwatch.h"
#include "core/global/global_mapper.h"
#include "core/global/submap_builder.h"

namespace gem::evaluation {
namespace {

constexpr char kSession[] = "bench";

absl::Status Validate(const GlobalBenchOptions& options) {
  GEM_RETURN_IF_ERROR(CheckRange("way_m", options.way_m, 100, 100'000));
  GEM_RETURN_IF_ERROR(CheckRange("width_m", options.width_m, 1, 100));
  GEM_RETURN_IF_ERROR(CheckRange("threads", options.threads, 1, 64));
  return CheckRange("corrections", options.num_corrections, 1, 10'000);
}

CellBelief GroundAt(CellIndex cell, std::int64_t stamp_ns) {
  CellBelief belief;
  belief.elevation_m = MadeUpGroundAt(cell);
  belief.variance_m2 = 4e-4f;
  belief.traversability = 0.9f;
  belief.stamp_ns = stamp_ns;
  belief.state = kCellKnown | kCellAnnotated;
  return belief;
}

/// The map, built as a session builds it.
class Site {
 public:
  explicit Site(const GlobalBenchOptions& options)
      : options_(options), map_options_(MapOptions(options)), map_(map_options_, /*epoch=*/1) {
    GEM_CHECK(map_.AddSession(kSession, "robot", {}).ok());
  }

  void Build() {
    SubmapBuilder builder(kSession, "robot", map_options_);
    SessionUpdate update;
    std::vector<EvictedCell> evicted;
    const auto steps = static_cast<std::int64_t>(options_.way_m / kMadeUpStep_m);
    for (std::int64_t i = 0; i < steps; ++i) {
      const std::int64_t stamp_ns = (i + 1) * kMadeUpStep_ns;
      const Pose<Odom, Base> T_O_B =
          MadeUpPoseAt(static_cast<double>(i) * kMadeUpStep_m, 2 * options_.width_m);
      update.odometry.push_back({stamp_ns, T_O_B});
      auto finished = builder.Add(stamp_ns, T_O_B, {}, evicted);
      if (finished != nullptr) update.finished.push_back(std::move(finished));
      StripAt(T_O_B, stamp_ns, evicted);
    }
    auto last = builder.Finish(evicted);
    if (last != nullptr) update.finished.push_back(std::move(last));
    update.ended = true;
    poses_ = update.odometry;
    GEM_CHECK(map_.Update(kSession, std::move(update)).ok());
    CommitReport report;
    map_.Commit(CancelToken(), report);
  }

  /// Bends everything after `begin` of the way, [0, 1), a little differently each time.
  CorrectionCounts Bend(double begin, int number) {
    auto counts = map_.Correct(kSession, BendDrive(poses_, begin, number));
    GEM_CHECK(counts.ok());
    return *counts;
  }

  CommitReport Commit() {
    CommitReport report;
    map_.Commit(CancelToken(), report);
    return report;
  }

  std::shared_ptr<const MapSnapshot> snapshot() const { return map_.snapshot(); }

 private:
  static GlobalMapOptions MapOptions(const GlobalBenchOptions& options) {
    GlobalMapOptions map;
    map.cell_size_m = options.cell_size_m;
    map.submap_length_m = options.submap_length_m;
    map.compose_threads = options.threads;
    return map;
  }

  /// The cells that the robot leaves behind with one step.
  void StripAt(const Pose<Odom, Base>& T_O_B, std::int64_t stamp_ns,
               std::vector<EvictedCell>& evicted) const {
    evicted.clear();
    const Eigen::Vector3d& base = T_O_B.translation();
    const double half_m = options_.width_m / 2;
    const CellIndex low = CellAt(base.x(), base.y() - half_m, options_.cell_size_m);
    const CellIndex high =
        CellAt(base.x() + kMadeUpStep_m, base.y() + half_m, options_.cell_size_m);
    for (std::int32_t y = low.y; y < high.y; ++y)
      for (std::int32_t x = low.x; x < high.x; ++x)
        evicted.push_back({{x, y}, GroundAt({x, y}, stamp_ns)});
  }

  // Constant after construction.
  const GlobalBenchOptions options_;
  const GlobalMapOptions map_options_;

  GlobalMapper map_;
  std::vector<StampedPose<Odom, Base>> poses_;
};

struct Samples {
  std::vector<double> correction_ms, deform_ms, merge_ms, compose_ms, coarsen_ms, tiles;
};

Samples TimeCorrections(Site& site, double begin, int count) {
  Samples samples;
  for (int i = 0; i < count; ++i) {
    Stopwatch stopwatch;
    site.Bend(begin, i + 1);
    const CommitReport report = site.Commit();
    samples.correction_ms.push_back(stopwatch.Lap() * 1e3);
    samples.deform_ms.push_back(report.seconds.deform * 1e3);
    samples.merge_ms.push_back(report.seconds.merge * 1e3);
    samples.compose_ms.push_back(report.seconds.compose * 1e3);
    samples.coarsen_ms.push_back(report.seconds.coarsen * 1e3);
    samples.tiles.push_back(report.num_touched_tiles);
  }
  return samples;
}

std::size_t KnownCells(const MapSnapshot& map) {
  std::size_t count = 0;
  for (const auto& [index, tile] : map.tiles)
    count += static_cast<std::size_t>(
        std::count_if(tile->cells.begin(), tile->cells.end(),
                      [](const CellBelief& cell) { return cell.known(); }));
  return count;
}

}  // namespace

absl::StatusOr<GlobalBench> BenchGlobal(const GlobalBenchOptions& options) {
  GEM_RETURN_IF_ERROR(Validate(options));
  Site site(options);
  site.Build();
  GlobalBench bench;
  bench.num_submaps = site.snapshot()->submaps.size();
  bench.num_points = site.snapshot()->num_points;
  bench.size_bytes = site.snapshot()->submap_bytes;

  const Samples whole = TimeCorrections(site, 0, options.num_corrections);
  bench.num_tiles = site.snapshot()->tiles.size();
  for (const TileMap& level : site.snapshot()->coarser) bench.num_coarser_tiles += level.size();
  bench.num_touched_tiles = static_cast<std::size_t>(DistributionOf(whole.tiles).median);
  bench.correction = DistributionOf(whole.correction_ms);
  bench.deform = DistributionOf(whole.deform_ms);
  bench.merge = DistributionOf(whole.merge_ms);
  bench.compose = DistributionOf(whole.compose_ms);
  bench.coarsen = DistributionOf(whole.coarsen_ms);
  const double compose_s = bench.compose.median * 1e-3;
  bench.known_cells_per_s = static_cast<double>(KnownCells(*site.snapshot())) / compose_s;
  bench.tile_cells_per_s =
      static_cast<double>(bench.num_touched_tiles) * kTileCells * kTileCells / compose_s;

  const Samples tenth = TimeCorrections(site, 0.9, options.num_corrections);
  bench.num_touched_tiles_of_tenth = static_cast<std::size_t>(DistributionOf(tenth.tiles).median);
  bench.correction_of_tenth = DistributionOf(tenth.correction_ms);
  return bench;
}

std::string GlobalBenchJson(const GlobalBench& b) {
  const auto of = [](const Distribution_ms& d) {
    return absl::StrFormat("{\"median\":%.4f,\"p95\":%.4f}", d.median, d.p95);
  };
  return absl::StrFormat(
      "{\"submaps\":%d,\"points\":%d,\"bytes\":%d,\"tiles\":%d,\"coarser_tiles\":%d,"
      "\"touched_tiles\":%d,\"correction_ms\":%s,\"deform_ms\":%s,\"merge_ms\":%s,\"compose_ms\":%"
      "s,"
      "\"coarsen_ms\":%s,"
      "\"known_cells_per_s\":%.0f,\"tile_cells_per_s\":%.0f,"
      "\"touched_tiles_of_tenth\":%d,\"correction_of_tenth_ms\":%s}\n",
      b.num_submaps, b.num_points, b.size_bytes, b.num_tiles, b.num_coarser_tiles,
      b.num_touched_tiles, of(b.correction), of(b.deform), of(b.merge), of(b.compose),
      of(b.coarsen), b.known_cells_per_s, b.tile_cells_per_s, b.num_touched_tiles_of_tenth,
      of(b.correction_of_tenth));
}

std::string GlobalBenchTable(const GlobalBench& b) {
  std::string table = absl::StrFormat(
      "%d submaps, %d points, %.1f MB, %d tiles, %d of coarser levels\n%-34s %8s %8s\n",
      b.num_submaps, b.num_points, static_cast<double>(b.size_bytes) * 1e-6, b.num_tiles,
      b.num_coarser_tiles, "ms", "median", "p95");
  const auto add = [&table](const std::string& name, const Distribution_ms& d) {
    absl::StrAppendFormat(&table, "%-34s %8.2f %8.2f\n", name, d.median, d.p95);
  };
  add(absl::StrFormat("correction of all (%d tiles)", b.num_touched_tiles), b.correction);
  add("  deform", b.deform);
  add("  merge", b.merge);
  add("  compose", b.compose);
  add("  coarsen", b.coarsen);
  add(absl::StrFormat("correction of a tenth (%d tiles)", b.num_touched_tiles_of_tenth),
      b.correction_of_tenth);
  absl::StrAppendFormat(&table, "composed: %.1f million known cells/s, %.1f million with unknown\n",
                        b.known_cells_per_s * 1e-6, b.tile_cells_per_s * 1e-6);
  return table;
}

}  // namespace gem::evaluation
