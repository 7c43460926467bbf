// The cpu backend's pass over the points of a scan, the only one: each point is measured, its ray
// is entered into the ray table and its hit is listed, while it is in the first-level cache.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "core/base/vector_set.h"
#include "core/local/fuse.h"
#include "core/local/measure.h"
#include "core/local/ray_table.h"

namespace gem::cpu {

/// What one thread measured of a scan: some runs of its points. Kept from scan to scan, so that
/// nothing is allocated.
struct MeasuredPart {
  MeasuredPart(std::size_t num_cells, const RayBins& bins) : rays(bins), count_of_cell(num_cells) {}

  RayTable rays;

  // Hits, of each run in point order; the first num_hits of each list.
  std::size_t num_hits = 0;
  std::vector<std::uint32_t> cell;  ///< window index: row * side_cells + column
  std::vector<float> elevation_m;
  std::vector<float> variance_m2;  ///< of the sensor alone
  std::vector<Rgba> rgba;          ///< means something if is_colored
  bool is_colored = false;         ///< some point has a colour

  std::vector<std::uint32_t> count_of_cell;  ///< hits by window index; all zero between scans

  std::array<std::uint32_t, 6> fates = {};  ///< points by PointFate
};

/// The hits of one run of points: [begin, end) in the lists of `part`.
struct HitRun {
  const MeasuredPart* part = nullptr;
  std::size_t begin = 0, end = 0;
};

/// Empties `part` for a scan of num_points points. Rays that end later than range bin
/// `range_bin_limit` will be kept as if they ended in it.
void BeginPart(std::size_t num_points, std::int32_t range_bin_limit, MeasuredPart& part);

/// Measures a run of points into `part`, after what it holds already.
HitRun MeasurePoints(VectorSet set, const ScanFrame& frame, std::span<const ScanPoint> points,
                     std::int32_t range_bin_limit, MeasuredPart& part);

}  // namespace gem::cpu
