#include "core/local/cpu/fuse_cells.h"

#include <algorithm>

namespace gem::cpu {
namespace {

constexpr std::size_t kLanes = HitLanes::kLanes;

// Where the cells of a group are. Behind the last cell of the last group, where that one is.
struct LanePlaces {
  alignas(64) std::uint32_t index[kLanes];
  alignas(64) std::uint32_t slot[kLanes];
};

void Load(const FuseTarget& target, const HitLanes& hits, std::size_t first_rank, std::size_t count,
          LanePlaces& places, LaneCells& cells) {
  const ScanFrame& frame = target.frame;
  const std::uint32_t* cell_of = hits.cells() + first_rank;
  const std::uint32_t* count_of = hits.counts() + first_rank;
  GEM_INDEPENDENT
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    const Place place = target.window.PlaceOf(cell_of[lane]);
    places.index[lane] = cell_of[lane];
    places.slot[lane] = target.window.SlotOf(place);
    cells.pose_m2[lane] = PoseVarianceOfCell(frame, place.column, place.row);
    cells.count[lane] = lane < count ? static_cast<std::int32_t>(count_of[lane]) : 0;
  }
  const float* elevation_m = target.layers.elevation_m.data();
  const float* variance_m2 = target.layers.variance_m2.data();
  const float* traversability = target.layers.traversability.data();
  alignas(64) float score[kLanes];
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    const std::uint32_t slot = places.slot[lane];
    cells.prior_m[lane] = elevation_m[slot];
    cells.prior_m2[lane] = variance_m2[slot];
    score[lane] = traversability[slot];
  }
  const float free_min = target.traversability_free;
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    // A known cell has at least the floor of variance, which is above zero.
    cells.known[lane] = ((cells.count[lane] != 0) & (cells.prior_m2[lane] > 0.0f)) ? 1 : 0;
    cells.is_free[lane] = score[lane] > free_min ? 1 : 0;
  }
}

// Of a scan without colours: a cell keeps its own unless it begins anew.
void Store(const FuseTarget& target, const LanePlaces& places, std::size_t count,
           const LaneCells& cells) {
  // Copies, which stores below cannot change.
  float* elevation_m = target.layers.elevation_m.data();
  float* variance_m2 = target.layers.variance_m2.data();
  Rgba* rgba = target.layers.rgba.data();
  std::uint8_t* state = target.layers.state.data();
  std::int64_t* observed_ns = target.layers.observed_ns.data();
  std::uint8_t* confirmed = target.confirmed.data();
  const std::int64_t stamp_ns = target.stamp_ns;
  for (std::size_t lane = 0; lane < count; ++lane) {
    const std::uint32_t slot = places.slot[lane];
    elevation_m[slot] = cells.elevation_m[lane];
    variance_m2[slot] = cells.variance_m2[lane];
    if (cells.begun[lane] != 0) {
      rgba[slot] = 0;
      state[slot] = kCellKnown;
    }
    if (cells.fused[lane] == 0) continue;
    observed_ns[slot] = stamp_ns;
    confirmed[places.index[lane]] = 1;
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
  RunVectorised(target.set, [&] {
    LanePlaces places;
    LaneCells cells;
    for (std::size_t group = 0; group < hits.num_groups(); ++group) {
      const std::size_t first = hits.FirstRankOf(group);
      const std::size_t count = std::min(kLanes, hits.num_cells() - first);
      Load(target, hits, first, count, places, cells);
      FuseLanes(target.set, hits.HeightsOf(group), static_cast<std::int32_t>(hits.CountOf(first)),
                target.limits, cells);
      Store(target, places, count, cells);
      Count(cells, report);
    }
  });
}

}  // namespace gem::cpu
