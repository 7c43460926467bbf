// Answers with a local map (GetLocalMap, WatchLocalMap), put together from a grid that was encoded
// once for all who read it.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "core/grid/layered_grid.h"
#include "core/local/local_map.h"
#include "proto/wire/grid.h"
#include "proto/wire/map.h"
#include "proto/wire/spliced_message.h"
#include "proto/wire/tile_message.h"

namespace gem::wire {

/// The cells as gem.v1.Grid, without etag.
EncodedCells EncodeGrid(const LocalMap& map, std::span<const Layer> layers, CellEncoding encoding);

/// gem.v1.GetLocalMapResponse.
SplicedMessage GetLocalMapMessage(const LocalMap& map, const LocalMapContext& context,
                                  const std::shared_ptr<const EncodedCells>& grid);
/// gem.v1.WatchLocalMapResponse.
SplicedMessage WatchLocalMapMessage(const LocalMap& map, const LocalMapContext& context,
                                    const std::shared_ptr<const EncodedCells>& grid,
                                    std::uint64_t num_skipped);

}  // namespace gem::wire
