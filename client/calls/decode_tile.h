// Tiles and local maps as they come from a server -> what users of the library get. What the server
// sent must be what was asked for: maps are drawn from it. Private to the library.
#pragma once

#include "absl/status/statusor.h"
#include "client/map_client.h"
#include "client/map_types.h"
#include "client/mirror_store.h"

namespace gem::v1 {
class GetTileMatrixResponse;
class LocalMap;
class Tile;
class WatchTilesResponse;
}  // namespace gem::v1

namespace gem::client {

/// INTERNAL for a geometry that this library does not know; RESOURCE_EXHAUSTED for too many tiles.
absl::StatusOr<TileMatrix> DecodeTileMatrix(const v1::GetTileMatrixResponse& proto, int level);

/// INTERNAL for a tile of another level or size, or without a layer of the selection.
absl::StatusOr<MapTile> DecodeTile(const v1::Tile& proto, int level,
                                   const CellSelection& selection);

/// INTERNAL for a tile that is no news, too.
absl::StatusOr<MirrorPart> DecodePart(const v1::WatchTilesResponse& proto, int level,
                                      const CellSelection& selection);

/// INTERNAL for a map without a layer of the selection.
absl::StatusOr<LocalMap> DecodeLocalMap(const v1::LocalMap& proto, const CellSelection& selection);

}  // namespace gem::client
