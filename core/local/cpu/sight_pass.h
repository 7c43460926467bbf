// Which of the cells that might be cleared are: many cells against the completed ray table.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/base/vector_set.h"
#include "core/local/cpu/layers.h"
#include "core/local/measure.h"
#include "core/local/ray_table.h"
#include "core/local/ring_window.h"

namespace gem::cpu {

/// Cells that might be cleared; the first `count` of each list.
struct ClearCandidates {
  explicit ClearCandidates(std::size_t count_max)
      : place(count_max), elevation_m(count_max), variance_m2(count_max), is_free(count_max) {}

  std::size_t count = 0;
  std::vector<Place> place;
  std::vector<float> elevation_m;
  std::vector<float> variance_m2;
  std::vector<std::int32_t> is_free;  ///< 0 or 1
};

/// The known cells of rows [row_begin, row_end) that no point of the scan confirmed (0 or 1 by
/// window index).
void FindCandidates(VectorSet set, const RingWindow& window, const Layers& layers,
                    float traversability_free, std::span<const std::uint8_t> confirmed,
                    std::int32_t row_begin, std::int32_t row_end, ClearCandidates& candidates);

/// Appends those candidates that rays pass below to `cleared`, in their order.
void FindPassedBelow(VectorSet set, const RayTable& rays, const ScanFrame& frame,
                     const LocalMapOptions& options, const ClearCandidates& candidates,
                     std::vector<Place>& cleared);

}  // namespace gem::cpu
