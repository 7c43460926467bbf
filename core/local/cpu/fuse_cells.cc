#include "core/local/cpu/fuse_cells.h"

#include <algorithm>

namespace gem::cpu {
namespace {

constexpr std::size_t kLanes = HitLanes::kLanes;

void Load(const FuseTarget& target, const HitLanes& hits, std::size_t first_rank, std::size_t count,
          LaneCells& cells) {
  const Layers& layers = target.layers;
  for (std::size_t lane = 0; lane < count; ++lane) {
    const Place place = target.window.PlaceOf(hits.CellOf(first_rank + lane));
    const std::uint32_t slot = target.window.SlotOf(place);
    cells.prior_m[lane] = layers.elevation_m[slot];
    cells.prior_m2[lane] = layers.variance_m2[slot];
    cells.pose_m2[lane] = PoseVarianceOfCell(target.frame, place.column, place.row);
    cells.known[lane] = layers.known(slot) ? 1 : 0;
    cells.is_free[lane] = layers.IsFree(slot, target.traversability_free) ? 1 : 0;
    cells.count[lane] = static_cast<std::int32_t>(hits.CountOf(first_rank + lane));
  }
  for (std::size_t lane = count; lane < kLanes; ++lane) {
    cells.prior_m[lane] = cells.prior_m2[lane] = cells.pose_m2[lane] = 0;
    cells.known[lane] = cells.is_free[lane] = cells.count[lane] = 0;
  }
}

// Of a scan without colours: a cell keeps its own unless it begins anew.
void Store(const FuseTarget& target, const HitLanes& hits, std::size_t first_rank,
           std::size_t count, const LaneCells& cells) {
  Layers& layers = target.layers;
  for (std::size_t lane = 0; lane < count; ++lane) {
    const std::uint32_t index = hits.CellOf(first_rank + lane);
    const std::uint32_t slot = target.window.SlotOf(target.window.PlaceOf(index));
    layers.elevation_m[slot] = cells.elevation_m[lane];
    layers.variance_m2[slot] = cells.variance_m2[lane];
    if (cells.begun[lane] != 0) {
      layers.rgba[slot] = 0;
      layers.state[slot] = kCellKnown;
    }
    if (cells.fused[lane] == 0) continue;
    layers.observed_ns[slot] = target.stamp_ns;
    target.confirmed[index] = 1;
  }
}

void Count(const LaneCells& cells, ScanReport& report) {
  std::int32_t hits = 0, fused = 0, restarted = 0, inflated = 0;
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    hits += cells.count[lane];
    fused += cells.count[lane] != 0 ? cells.fused[lane] : 0;  // a lane without a cell also begins
    restarted += cells.restarted[lane];
    inflated += cells.inflated[lane];
  }
  report.points_fused += static_cast<std::uint64_t>(fused);
  report.points_gated += static_cast<std::uint64_t>(hits - fused);
  report.cells_restarted += static_cast<std::uint64_t>(restarted);
  report.cells_inflated += static_cast<std::uint64_t>(inflated);
}

}  // namespace

FuseOutcome FuseRank(const FuseTarget& target, const HitLanes& hits, std::size_t rank,
                     std::vector<Hit>& buffer) {
  Layers& layers = target.layers;
  const std::uint32_t index = hits.CellOf(rank);
  const Place place = target.window.PlaceOf(index);
  const std::uint32_t slot = target.window.SlotOf(place);
  CellFusion cell;
  if (layers.known(slot)) {
    cell = UnpackCell({layers.elevation_m[slot], layers.variance_m2[slot]}, layers.rgba[slot]);
  }
  const std::span<const Hit> of_cell = hits.HitsOf(rank, buffer);
  const FuseOutcome outcome =
      FuseCell(cell, of_cell.data(), static_cast<std::uint32_t>(of_cell.size()),
               layers.IsFree(slot, target.traversability_free),
               PoseVarianceOfCell(target.frame, place.column, place.row), target.limits);
  layers.elevation_m[slot] = cell.height.elevation_m;
  layers.variance_m2[slot] = cell.height.variance_m2;
  layers.rgba[slot] = PackColor(cell);
  layers.state[slot] = static_cast<std::uint8_t>(kCellKnown | (cell.colored ? kCellColored : 0));
  if (outcome.fused > 0) {
    layers.observed_ns[slot] = target.stamp_ns;
    target.confirmed[index] = 1;
  }
  return outcome;
}

void FuseCells(const FuseTarget& target, const HitLanes& hits, std::vector<Hit>& buffer,
               ScanReport& report) {
  const std::size_t num_alone = hits.is_colored() ? hits.num_cells() : hits.num_long();
  for (std::size_t rank = 0; rank < num_alone; ++rank) {
    const FuseOutcome outcome = FuseRank(target, hits, rank, buffer);
    report.points_fused += outcome.fused;
    report.points_gated += outcome.gated;
    report.cells_restarted += outcome.restarted ? 1 : 0;
    report.cells_inflated += outcome.inflated ? 1 : 0;
  }
  if (hits.is_colored()) return;
  LaneCells cells;
  for (std::size_t group = 0; group < hits.num_groups(); ++group) {
    const std::size_t first = hits.FirstRankOf(group);
    const std::size_t count = std::min(kLanes, hits.num_cells() - first);
    Load(target, hits, first, count, cells);
    FuseLanes(target.set, hits.HeightsOf(group), static_cast<std::int32_t>(hits.CountOf(first)),
              target.limits, cells);
    Store(target, hits, first, count, cells);
    Count(cells, report);
  }
}

}  // namespace gem::cpu
