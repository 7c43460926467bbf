// What came of hiding a session's contribution, or of showing it again, for those who asked.
#pragma once

#include <cstdint>

namespace gem {

/// What a retraction took out of the map, or what came back.
struct RetractionCounts {
  std::uint32_t num_submaps = 0;  ///< whole ones, the active one included
  /// Cells in other sessions' submaps, or fused with other sessions' cells.
  std::uint64_t num_merged_cells = 0;
};

}  // namespace gem
