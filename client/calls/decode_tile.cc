#include "client/calls/decode_tile.h"

#include <utility>

#include "absl/strings/str_cat.h"
#include "core/base/status_macros.h"
#include "gem/v1/tile_service.pb.h"
#include "proto/wire/map.h"

namespace gem::client {
namespace {

/// Tiles of one map: 4 million are 65,000 km^2 at 1 m.
constexpr int kTilesMax = 1 << 22;

absl::Status CheckLevel(const TileAddress& tile, int level) {
  if (tile.level == level) return absl::OkStatus();
  return absl::InternalError(
      absl::StrCat("the server sent a tile of level ", tile.level, ", want ", level));
}

absl::Status CheckLayers(const LayeredGrid& grid, const CellSelection& selection,
                         absl::string_view what) {
  for (const Layer layer : selection.layers)
    if (grid.Find(layer) == nullptr)
      return absl::InternalError(
          absl::StrCat("the server sent a ", what, " without layer ", NameOf(layer)));
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<TileMatrix> DecodeTileMatrix(const v1::GetTileMatrixResponse& proto, int level) {
  if (proto.tile_cells() != kTileCells)
    return absl::InternalError(absl::StrCat("the server has tiles of ", proto.tile_cells(),
                                            " cells a side, want ", kTileCells));
  if (!(proto.cell_size_m() > 0 && proto.cell_size_m() <= kCellSizeMax_m))
    return absl::InternalError(absl::StrCat("the server has cells of ", proto.cell_size_m(),
                                            " m, want (0, ", kCellSizeMax_m, "]"));
  if (proto.tiles_size() > kTilesMax)
    return absl::ResourceExhaustedError(absl::StrCat(
        "the map has ", proto.tiles_size(), " tiles, this client takes at most ", kTilesMax));
  TileMatrix matrix;
  matrix.level = level;
  matrix.level_max = static_cast<int>(proto.max_level());
  matrix.cell_size_m = CellSizeAt(level, proto.cell_size_m());
  matrix.traversability_free = proto.traversability_free();
  matrix.version = wire::FromProto(proto.version());
  matrix.tiles.reserve(static_cast<std::size_t>(proto.tiles_size()));
  for (const v1::TileKey& key : proto.tiles()) {
    GEM_ASSIGN_OR_RETURN(const TileAddress tile, wire::FromProto(key, wire::FieldPath("tiles")));
    GEM_RETURN_IF_ERROR(CheckLevel(tile, level));
    matrix.tiles.push_back(tile.index);
  }
  return matrix;
}

absl::StatusOr<MapTile> DecodeTile(const v1::Tile& proto, int level,
                                   const CellSelection& selection) {
  GEM_ASSIGN_OR_RETURN(wire::DecodedTile decoded, wire::FromProto(proto, wire::FieldPath("tiles")));
  GEM_RETURN_IF_ERROR(CheckLevel(decoded.address, level));
  MapTile tile{decoded.address.index, decoded.version, decoded.etag, nullptr};
  if (!decoded.grid) return tile;
  GEM_RETURN_IF_ERROR(CheckLayers(*decoded.grid, selection, "tile"));
  tile.grid = std::make_shared<const LayeredGrid>(*std::move(decoded.grid));
  return tile;
}

absl::StatusOr<MirrorPart> DecodePart(const v1::WatchTilesResponse& proto, int level,
                                      const CellSelection& selection) {
  MirrorPart part;
  if (proto.has_base()) part.base = wire::FromProto(proto.base());
  part.version = wire::FromProto(proto.version());
  part.reset = proto.reset();
  part.complete = proto.complete();
  part.num_versions_skipped = proto.num_versions_skipped();
  part.tiles.reserve(static_cast<std::size_t>(proto.tiles_size()));
  for (const v1::Tile& tile_proto : proto.tiles()) {
    GEM_ASSIGN_OR_RETURN(MapTile tile, DecodeTile(tile_proto, level, selection));
    // Without cells it would pass for one that went.
    if (tile_proto.not_modified())
      return absl::InternalError("the server sent a tile of a change as not modified");
    part.tiles.push_back(std::move(tile));
  }
  return part;
}

absl::StatusOr<LocalMap> DecodeLocalMap(const v1::LocalMap& proto, const CellSelection& selection) {
  GEM_ASSIGN_OR_RETURN(wire::DecodedLocalMap decoded,
                       wire::FromProto(proto, wire::FieldPath("local_map")));
  GEM_RETURN_IF_ERROR(CheckLayers(decoded.grid, selection, "local map"));
  return LocalMap{decoded.stamp_ns, decoded.seq,   decoded.origin,  std::move(decoded.grid),
                  decoded.T_O_B,    decoded.T_G_O, decoded.session, decoded.traversability_free};
}

}  // namespace gem::client
