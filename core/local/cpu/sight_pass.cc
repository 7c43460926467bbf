#include "core/local/cpu/sight_pass.h"

#include <algorithm>

namespace gem::cpu {
namespace {

// Few enough that what is known of them stays in the first-level cache.
constexpr std::size_t kBlock = 128;

struct Sights {
  alignas(64) float x_m[kBlock], y_m[kBlock];  // corner of the cell from the sensor
  alignas(64) std::int32_t first_bin[kBlock], num_bins[kBlock], range_bin_min[kBlock];
  alignas(64) float near_m[kBlock], far_m[kBlock];
  alignas(64) float height_m[kBlock];
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

}  // namespace

void FindPassedBelow(VectorSet set, const RayTable& rays, const ScanFrame& frame,
                     const LocalMapOptions& options, const ClearCandidates& candidates,
                     std::size_t begin, std::size_t end, std::vector<Place>& cleared) {
  RunVectorised(set, [&] {
    Sights sights;
    for (std::size_t first = begin; first < end; first += kBlock) {
      const std::size_t count = std::min(kBlock, end - first);
      SeeCells(frame, rays.bins(), options, candidates, first, count, sights);
      for (std::size_t i = 0; i < count; ++i) {
        const CellSight sight{sights.first_bin[i], sights.num_bins[i], sights.range_bin_min[i],
                              sights.near_m[i], sights.far_m[i]};
        if (!rays.AllPassBelow(sight, frame.sensor_z_m, sights.height_m[i])) continue;
        cleared.push_back(candidates.place[first + i]);
      }
    }
  });
}

}  // namespace gem::cpu
