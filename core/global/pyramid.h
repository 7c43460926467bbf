// The levels of the map above 0, each half as fine as the one below it, for readers that look far
// or come over a thin link. Pure functions of the tiles below; a map's history does not show in
// them.
#pragma once

#include <array>
#include <vector>

#include "core/base/cancel_token.h"
#include "core/global/global_map_options.h"
#include "core/global/map_snapshot.h"
#include "core/grid/cell_belief.h"

namespace gem {

/// A cell and the 2x2 finer ones that it covers.
///   Known if any of them is. Elevation: their mean by inverse variance. Variance: that of ground
/// which is one of them with these weights, sum of w (variance + (elevation - mean)^2): how far the
/// ground under the cell may lie from its elevation, not how well the mean is known.
///   Traversability is their minimum, so that an obstacle never vanishes. It is there only if that
/// is an obstacle (at most traversability_free) or all four have one: unknown is never free.
///   The stamp is the newest one, the colour the mean of those that have one, weighted as above.
CellBelief Coarsen(const std::array<const CellBelief*, 4>& finer, float traversability_free);

/// Makes map.coarser fit map.tiles, of which `changed` differ from those that it fits now (or came,
/// or went). Only what covers them is built, on options.compose_threads; a tile whose cells come
/// out as they were stays, others get map.version. False if cancelled: then map.coarser is
/// unspecified.
[[nodiscard]] bool UpdatePyramid(std::vector<TileIndex> changed, const GlobalMapOptions& options,
                                 const CancelToken& cancel, MapSnapshot& map);

}  // namespace gem
