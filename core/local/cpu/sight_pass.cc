#include "core/local/cpu/sight_pass.h"

#include <algorithm>
#include <bit>

namespace gem::cpu {
namespace {

// Few enough that what is known of them stays in the first-level cache.
constexpr std::size_t kBlock = 128;

struct Sights {
  alignas(64) float x_m[kBlock], y_m[kBlock];  // corner of the cell from the sensor
  alignas(64) std::int32_t first_bin[kBlock], num_bins[kBlock], range_bin_min[kBlock];
  alignas(64) float near_m[kBlock], far_m[kBlock];
  alignas(64) float height_m[kBlock];
  alignas(64) std::int32_t maybe[kBlock];  // 0: surely not passed below

  CellSight At(std::size_t i) const {
    return {first_bin[i], num_bins[i], range_bin_min[i], near_m[i], far_m[i]};
  }
};

void SeeCells(const ScanFrame& frame, const RayBins& bins_in, const LocalMapOptions& options_in,
              const ClearCandidates& candidates, std::size_t begin, std::size_t count,
              Sights& sights) {
  const RayBins bins = bins_in;
  const LocalMapOptions options = options_in;
  const float cell_size_m = options.cell_size_m;
  const float sensor_x_m = frame.sensor_x_m, sensor_y_m = frame.sensor_y_m;
  const Place* place = candidates.place.data() + begin;
  float* __restrict x_m = sights.x_m, * __restrict y_m = sights.y_m;
  for (std::size_t i = 0; i < count; ++i) {
    x_m[i] = static_cast<float>(place[i].column) * cell_size_m - sensor_x_m;
    y_m[i] = static_cast<float>(place[i].row) * cell_size_m - sensor_y_m;
  }
  std::int32_t *__restrict first_bin = sights.first_bin, *__restrict num_bins = sights.num_bins,
                           *__restrict range_bin_min = sights.range_bin_min;
  float* __restrict near_m = sights.near_m, * __restrict far_m = sights.far_m;
  for (std::size_t i = 0; i < count; ++i) {
    const CellSight sight = SightOf(x_m[i], y_m[i], bins);
    first_bin[i] = sight.first_bin;
    num_bins[i] = sight.num_bins;
    range_bin_min[i] = sight.range_bin_min;
    near_m[i] = sight.near_m;
    far_m[i] = sight.far_m;
  }
  const float* elevation_m = candidates.elevation_m.data() + begin;
  const float* variance_m2 = candidates.variance_m2.data() + begin;
  const std::int32_t* is_free = candidates.is_free.data() + begin;
  float* __restrict height_m = sights.height_m;
  for (std::size_t i = 0; i < count; ++i) {
    height_m[i] = ClearHeightOf(elevation_m[i], variance_m2[i], is_free[i] != 0, options);
  }
}

// Asks the first azimuth bin of each cell: most are not passed below, and most of them show it
// there.
void AskFirstBins(const RayTable& rays, float sensor_z_m, std::size_t count, Sights& sights) {
  std::int32_t* __restrict maybe = sights.maybe;
  GEM_INDEPENDENT
  for (std::size_t i = 0; i < count; ++i) {
    const bool none_above =
        rays.NonePassesAbove(sights.At(i), sights.first_bin[i], sensor_z_m, sights.height_m[i]);
    maybe[i] = none_above ? 1 : 0;
  }
}

// Candidates among the cells [begin, end) of a row, which lie side by side in the ring.
void FindInRun(const RingWindow& window, const Layers& layers, float traversability_free,
               const std::uint8_t* confirmed, std::int32_t row, std::int32_t begin,
               std::int32_t end, ClearCandidates& candidates) {
  constexpr std::int32_t kWord = 32;
  for (std::int32_t first = begin; first < end; first += kWord) {
    const std::uint32_t first_slot = window.SlotAt(first, row);
    const std::int32_t count = std::min(kWord, end - first);
    // Bits first: asked cell by cell, the processor would guess wrong too often.
    std::int32_t flags[kWord] = {};
    const std::uint8_t* state = layers.state.data() + first_slot;
    for (std::int32_t i = 0; i < count; ++i) {
      flags[i] = state[i] & kCellKnown & (confirmed[first + i] ^ 1);
    }
    std::uint32_t bits = 0;
    for (std::int32_t i = 0; i < kWord; ++i) bits |= static_cast<std::uint32_t>(flags[i]) << i;
    for (; bits != 0; bits &= bits - 1) {
      const std::int32_t i = std::countr_zero(bits);
      const std::uint32_t slot = first_slot + static_cast<std::uint32_t>(i);
      const std::size_t at = candidates.count++;
      candidates.place[at] = {static_cast<std::int16_t>(first + i), static_cast<std::int16_t>(row)};
      candidates.elevation_m[at] = layers.elevation_m[slot];
      candidates.variance_m2[at] = layers.variance_m2[slot];
      candidates.is_free[at] = layers.IsFree(slot, traversability_free) ? 1 : 0;
    }
  }
}

}  // namespace

void FindCandidates(VectorSet set, const RingWindow& window, const Layers& layers,
                    float traversability_free, std::span<const std::uint8_t> confirmed,
                    std::int32_t row_begin, std::int32_t row_end, ClearCandidates& candidates) {
  RunVectorised(set, [&] {
    candidates.count = 0;
    const std::int32_t seam =
        window.side_cells() - FloorMod(window.origin().x, window.side_cells());
    for (std::int32_t row = row_begin; row < row_end; ++row) {
      const std::uint8_t* in_row =
          confirmed.data() + window.IndexOf({0, static_cast<std::int16_t>(row)});
      // A row of the window is two runs of its row in the ring: from the seam on, and before it.
      FindInRun(window, layers, traversability_free, in_row, row, 0, seam, candidates);
      FindInRun(window, layers, traversability_free, in_row, row, seam, window.side_cells(),
                candidates);
    }
  });
}

void FindPassedBelow(VectorSet set, const RayTable& rays, const ScanFrame& frame,
                     const LocalMapOptions& options, const ClearCandidates& candidates,
                     std::vector<Place>& cleared) {
  RunVectorised(set, [&] {
    Sights sights;
    for (std::size_t first = 0; first < candidates.count; first += kBlock) {
      const std::size_t count = std::min(kBlock, candidates.count - first);
      SeeCells(frame, rays.bins(), options, candidates, first, count, sights);
      AskFirstBins(rays, frame.sensor_z_m, count, sights);
      for (std::size_t i = 0; i < count; ++i) {
        if (sights.maybe[i] == 0) continue;
        if (!rays.AllPassBelow(sights.At(i), frame.sensor_z_m, sights.height_m[i])) continue;
        cleared.push_back(candidates.place[first + i]);
      }
    }
  });
}

}  // namespace gem::cpu
