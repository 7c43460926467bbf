// The cpu backend's pass over the points of a scan, the only one: each point is measured, its ray
// is entered into the ray table and its hit is listed, while it is in the first-level cache.
//
// Threads share the ray table: each owns the rays into a sector of azimuths, and measures the
// points that lie there, as far as that can be told from a look at a few of them. A ray that turns
// out to belong to another thread is kept for it.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "core/base/vector_set.h"
#include "core/local/cpu/point_runs.h"
#include "core/local/fuse.h"
#include "core/local/measure.h"
#include "core/local/ray_table.h"
#include "core/sensor/scan.h"

namespace gem::cpu {

/// A ray that another thread enters into the table.
struct StrayRay {
  RayPlace place;
  std::int32_t azimuth_bin = 0;
};

/// What one thread measured of a scan: some runs of its points. Kept from scan to scan, so that
/// nothing is allocated. A cache line of its own, as threads write theirs at once.
struct alignas(64) MeasuredPart {
  MeasuredPart(std::size_t num_cells, const AzimuthSector& sector_in)
      : sector(sector_in), count_of_cell(num_cells) {}

  const AzimuthSector sector;  ///< whose rays this thread enters into the table

  std::size_t num_strays = 0;
  std::vector<StrayRay> strays;  ///< the first num_strays; behind the sector

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

/// The hits of one run of points: [begin, end) in the lists of `part`. Neighbours are written by
/// different threads.
struct alignas(64) HitRun {
  const MeasuredPart* part = nullptr;
  std::size_t begin = 0, end = 0;
  /// Their cells are within [cell_min, cell_max].
  std::uint32_t cell_min = 0, cell_max = 0;
};

/// A scan and what its points are measured into.
struct PointPass {
  VectorSet set;
  const ScanFrame& frame;
  const Scan& scan;
  PointRuns& runs;         ///< of the points
  std::span<HitRun> hits;  ///< by run
  RayTable& rays;          ///< with the scan's limit
};

/// What a thread does: empties its part and its sector of the table, and measures runs until none
/// is left.
void MeasureRuns(const PointPass& pass, std::size_t thread, MeasuredPart& part);

/// Enters the rays into the sector of parts[thread] that other threads met.
void AddStrays(std::span<const MeasuredPart> parts, std::size_t thread, RayTable& rays);

}  // namespace gem::cpu
