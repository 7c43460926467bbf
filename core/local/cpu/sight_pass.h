// Which of the cells that might be cleared are: many cells against the completed ray table.
#pragma once

#include <cstdint>
#include <vector>

#include "core/base/vector_set.h"
#include "core/local/cpu/layers.h"
#include "core/local/measure.h"
#include "core/local/ray_table.h"

namespace gem::cpu {

/// Known cells that no point of the scan confirmed; the first `count` of each list.
struct ClearCandidates {
  explicit ClearCandidates(std::size_t num_cells)
      : place(num_cells), elevation_m(num_cells), variance_m2(num_cells), is_free(num_cells) {}

  std::size_t count = 0;
  std::vector<Place> place;
  std::vector<float> elevation_m;
  std::vector<float> variance_m2;
  std::vector<std::int32_t> is_free;  ///< 0 or 1
};

/// Appends those of candidates [begin, end) that rays pass below to `cleared`, in their order.
void FindPassedBelow(VectorSet set, const RayTable& rays, const ScanFrame& frame,
                     const LocalMapOptions& options, const ClearCandidates& candidates,
                     std::size_t begin, std::size_t end, std::vector<Place>& cleared);

}  // namespace gem::cpu
