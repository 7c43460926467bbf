// Fuses the sorted hits of a scan into the layers: most cells in groups, side by side, and what the
// lanes cannot do (colours, very many hits) cell by cell.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/base/vector_set.h"
#include "core/local/cpu/fuse_lanes.h"
#include "core/local/cpu/hit_lanes.h"
#include "core/local/cpu/layers.h"
#include "core/local/fuse.h"
#include "core/local/local_mapper.h"
#include "core/local/measure.h"
#include "core/local/ring_window.h"

namespace gem::cpu {

/// What cells are fused into, and with what.
struct FuseTarget {
  VectorSet set;
  const RingWindow& window;
  const ScanFrame& frame;
  FuseLimits limits;
  float traversability_free;
  std::int64_t stamp_ns;
  Layers& layers;
  std::span<std::uint8_t> confirmed;  ///< by window index; set to 1 where a point is in the cell
};

/// Fuses one cell by its rank.
FuseOutcome FuseRank(const FuseTarget& target, const HitLanes& hits, std::size_t rank,
                     std::vector<Hit>& buffer);

/// Fuses all cells, and adds what became of them to the report.
void FuseCells(const FuseTarget& target, const HitLanes& hits, std::vector<Hit>& buffer,
               ScanReport& report);

}  // namespace gem::cpu
