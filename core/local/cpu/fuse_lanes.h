// FuseCell of core/local/fuse.h for a group of cells side by side, one in each lane of the vectors.
// Heights only: a scan with colours is fused cell by cell.
#pragma once

#include <cstdint>

#include "core/base/vector_set.h"
#include "core/local/cpu/hit_lanes.h"
#include "core/local/fuse.h"

namespace gem::cpu {

/// Cells of a group before and after a scan. Flags are 0 or 1, as wide as floats are.
struct LaneCells {
  static constexpr std::size_t kLanes = HitLanes::kLanes;

  // Before. A lane without a cell has a count of 0.
  alignas(64) float prior_m[kLanes];
  alignas(64) float prior_m2[kLanes];
  alignas(64) float pose_m2[kLanes];
  alignas(64) std::int32_t known[kLanes];
  alignas(64) std::int32_t is_free[kLanes];
  alignas(64) std::int32_t count[kLanes];

  // After.
  alignas(64) float elevation_m[kLanes];
  alignas(64) float variance_m2[kLanes];
  alignas(64) std::int32_t fused[kLanes];
  alignas(64) std::int32_t begun[kLanes];  ///< the prior was unknown, or is forgotten
  alignas(64) std::int32_t restarted[kLanes];
  alignas(64) std::int32_t inflated[kLanes];
};

/// Fuses the hits of a group (HitLanes::HeightsOf) into its cells; count_max of the lanes' counts.
void FuseLanes(VectorSet set, const float* heights, std::int32_t count_max,
               const FuseLimits& limits, LaneCells& cells);

}  // namespace gem::cpu
