// Map maintenance (paper section V-C): a submap that lies on an older one is merged into it, so
// that storage depends on the area and not on the path.
#pragma once

#include <memory>
#include <vector>

#include "absl/container/flat_hash_set.h"
#include "core/base/cancel_token.h"
#include "core/global/global_map_options.h"
#include "core/global/placement.h"

namespace gem {

/// True if the newer submap lies on the older one: at least merge_overlap_min of its cells lie on
/// known cells, and the median of their height differences is at most
/// merge_height_difference_m_max.
bool ShouldMerge(const PlacedSubmap& older, const PlacedSubmap& newer,
                 const GlobalMapOptions& options);

/// The older submap with the newer one's cells, eq. (12), gathered onto its cells: fused where they
/// were observed within merge_fuse_time_s_max of each other and agree within the gate, else the
/// newer observation stays. Keeps the older one's origin. A cell that one of the others knows does
/// not enter: they are refreshed with it. Cells remember who contributed. Null if the result would
/// be longer or wider than kSubmapSideCells_max, or have more than kSources_max sources.
std::shared_ptr<const Submap> Merge(
    const PlacedSubmap& older, const PlacedSubmap& newer, const GlobalMapOptions& options,
    const std::vector<std::shared_ptr<const PlacedSubmap>>& others = {});

/// The stored submap's own cells, joined with the newer one's as in Merge; no other cell enters.
std::shared_ptr<const Submap> Refresh(const PlacedSubmap& stored, const PlacedSubmap& newer,
                                      const GlobalMapOptions& options);

/// Result of the maintenance of a whole map.
struct Maintenance {
  std::vector<std::shared_ptr<const PlacedSubmap>> submaps;  ///< what is left, by id
  std::uint32_t num_merged = 0;
  bool cancelled = false;  ///< submaps is empty
};

/// Merges each finished submap named in `changed` (new, or moved) with the nearest finished one
/// that it should be merged with. The older one of a pair stays. What of the newer one lies on the
/// ground of a third goes there, so that no ground is stored twice. `submaps` by id. The result
/// depends on what the submaps are, not on the order in which they arrived.
Maintenance Maintain(std::vector<std::shared_ptr<const PlacedSubmap>> submaps,
                     const absl::flat_hash_set<SubmapId>& changed, const GlobalMapOptions& options,
                     const CancelToken& cancel);

}  // namespace gem
