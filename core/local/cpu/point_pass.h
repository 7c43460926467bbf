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

/// A part of a scan's points, measured. Kept from scan to scan, so that nothing is allocated.
struct MeasuredPart {
  MeasuredPart(std::size_t num_cells, const RayBins& bins)
      : rays(bins), count_of_cell(num_cells), touched(num_cells) {}

  RayTable rays;

  // Hits in point order; the first num_hits of each list.
  std::size_t num_hits = 0;
  std::vector<std::uint32_t> cell;  ///< window index: row * side_cells + column
  std::vector<Height> height;       ///< variance: of the sensor alone
  std::vector<Rgba> rgba;
  bool is_colored = false;  ///< some hit has a colour

  std::vector<std::uint32_t> count_of_cell;  ///< hits by window index; all zero between scans
  std::vector<std::uint32_t> touched;        ///< cells with hits; the first num_touched
  std::size_t num_touched = 0;

  std::array<std::uint32_t, 6> fates = {};  ///< points by PointFate
};

/// Measures `points` into `part`, replacing what it held. Rays that end later than range bin
/// `range_bin_limit` are kept as if they ended in it.
void MeasurePoints(VectorSet set, const ScanFrame& frame, std::span<const ScanPoint> points,
                   std::int32_t range_bin_limit, MeasuredPart& part);

}  // namespace gem::cpu
