// MapClient: tiles and local maps.
#include <algorithm>
#include <span>
#include <utility>

#include "absl/container/flat_hash_map.h"
#include "absl/strings/str_cat.h"
#include "client/calls/decode_tile.h"
#include "client/calls/map_stubs.h"
#include "client/calls/select_cells.h"
#include "client/map_client.h"
#include "core/base/status_macros.h"
#include "proto/wire/map.h"

namespace gem::client {
namespace {

constexpr std::size_t kTilesOfBatchMax = 64;

using HeldTiles = absl::flat_hash_map<TileIndex, const MapTile*>;

HeldTiles IndexOf(const TileSet* held) {
  HeldTiles tiles;
  if (held == nullptr) return tiles;
  for (const MapTile& tile : held->tiles)
    if (tile.grid != nullptr && tile.etag != 0) tiles[tile.index] = &tile;
  return tiles;
}

v1::BatchGetTilesRequest BatchRequest(const std::string& map, std::span<const TileIndex> tiles,
                                      const CellSelection& selection, int level,
                                      const std::optional<MapVersion>& at, const HeldTiles& held) {
  v1::BatchGetTilesRequest request;
  request.set_map(map);
  SelectCells(selection, request);
  if (at) wire::ToProto(*at, request.mutable_at());
  for (const TileIndex tile : tiles) {
    wire::ToProto(TileAddress{level, tile}, request.add_tiles());
    if (held.empty()) continue;
    const auto found = held.find(tile);
    request.add_if_none_match(found == held.end() ? 0 : found->second->etag);
  }
  return request;
}

std::string NameOf(int level, TileIndex tile) {
  return absl::StrCat("(", level, ", ", tile.x, ", ", tile.y, ")");
}

/// A tile of an answer, which must be the one that was asked for.
absl::StatusOr<MapTile> TakeTile(const v1::Tile& proto, TileIndex wanted, int level,
                                 const CellSelection& selection, const HeldTiles& held) {
  GEM_ASSIGN_OR_RETURN(MapTile tile, DecodeTile(proto, level, selection));
  if (tile.index != wanted)
    return absl::InternalError(absl::StrCat("the server sent tile ", NameOf(level, tile.index),
                                            " instead of ", NameOf(level, wanted)));
  if (!proto.not_modified()) return tile;
  const auto found = held.find(wanted);
  if (found == held.end() || found->second->etag != tile.etag)
    return absl::InternalError(absl::StrCat("the server sent tile ", NameOf(level, wanted),
                                            " as not modified, which it is not"));
  tile.grid = found->second->grid;
  return tile;
}

/// True if tile and region share a cell's area.
bool Touches(TileIndex tile, const Region& region, double cell_size_m) {
  const double side_m = cell_size_m * kTileCells;
  return tile.x * side_m < region.x_m_max && (tile.x + 1) * side_m > region.x_m_min &&
         tile.y * side_m < region.y_m_max && (tile.y + 1) * side_m > region.y_m_min;
}

absl::Status ForgottenError(const std::string& map, int tries) {
  return absl::AbortedError(absl::StrCat("the version of map ", map,
                                         " that was read was forgotten ", tries,
                                         " times before it was complete"));
}

}  // namespace

absl::StatusOr<TileMatrix> MapClient::GetTileMatrix(const std::string& map, int level) const {
  v1::GetTileMatrixRequest request;
  v1::GetTileMatrixResponse response;
  request.set_map(map);
  request.set_level(static_cast<std::uint32_t>(level));
  GEM_RETURN_IF_ERROR(stubs_->Call(*stubs_->tile, &v1::TileService::Stub::GetTileMatrix,
                                   options_.deadline_s, request, response));
  return DecodeTileMatrix(response, level);
}

absl::StatusOr<TileSet> MapClient::GetTilesOnce(const std::string& map,
                                                const std::vector<TileIndex>& tiles,
                                                const CellSelection& selection,
                                                const TileQuery& query) const {
  const HeldTiles held = IndexOf(query.held);
  TileSet set;
  set.tiles.reserve(tiles.size());
  std::optional<MapVersion> at = query.at;
  while (set.tiles.size() < tiles.size()) {
    const std::span<const TileIndex> batch =
        std::span(tiles)
            .subspan(set.tiles.size())
            .first(std::min(kTilesOfBatchMax, tiles.size() - set.tiles.size()));
    v1::BatchGetTilesResponse response;
    GEM_RETURN_IF_ERROR(
        stubs_->Call(*stubs_->tile, &v1::TileService::Stub::BatchGetTiles, options_.deadline_s,
                     BatchRequest(map, batch, selection, query.level, at, held), response));
    if (static_cast<std::size_t>(response.tiles_size()) != batch.size())
      return absl::InternalError(absl::StrCat("the server sent ", response.tiles_size(),
                                              " tiles instead of ", batch.size()));
    set.version = wire::FromProto(response.version());
    if (at.value_or(set.version) != set.version)
      return absl::InternalError(absl::StrCat("the server sent tiles of revision ",
                                              set.version.revision, " instead of ", at->revision));
    // The other batches are of the version that the first one was.
    at = set.version;
    for (std::size_t i = 0; i < batch.size(); ++i) {
      GEM_ASSIGN_OR_RETURN(MapTile tile, TakeTile(response.tiles(static_cast<int>(i)), batch[i],
                                                  query.level, selection, held));
      set.tiles.push_back(std::move(tile));
    }
  }
  return set;
}

absl::StatusOr<TileSet> MapClient::GetTiles(const std::string& map,
                                            const std::vector<TileIndex>& tiles,
                                            const CellSelection& selection,
                                            const TileQuery& query) const {
  for (int tries = 0; tries < options_.consistent_tries_max; ++tries) {
    absl::StatusOr<TileSet> set = GetTilesOnce(map, tiles, selection, query);
    if (query.at || !IsRevisionExpired(set.status())) return set;
  }
  return ForgottenError(map, options_.consistent_tries_max);
}

absl::StatusOr<TiledMap> MapClient::ReadMap(const std::string& map,
                                            const std::optional<Region>& region,
                                            const CellSelection& selection, int level,
                                            const TileSet* held) const {
  for (int tries = 0; tries < options_.consistent_tries_max; ++tries) {
    GEM_ASSIGN_OR_RETURN(TileMatrix matrix, GetTileMatrix(map, level));
    if (region)
      std::erase_if(matrix.tiles,
                    [&](TileIndex tile) { return !Touches(tile, *region, matrix.cell_size_m); });
    if (matrix.tiles.empty()) return TiledMap{matrix, {matrix.version, {}}};
    absl::StatusOr<TileSet> tiles =
        GetTilesOnce(map, matrix.tiles, selection, {level, matrix.version, held});
    if (tiles.ok()) return TiledMap{std::move(matrix), *std::move(tiles)};
    if (!IsRevisionExpired(tiles.status())) return tiles.status();
  }
  return ForgottenError(map, options_.consistent_tries_max);
}

absl::StatusOr<LocalMap> MapClient::GetLocalMap(const std::string& robot,
                                                const CellSelection& selection) const {
  v1::GetLocalMapRequest request;
  v1::GetLocalMapResponse response;
  request.set_robot(robot);
  SelectCells(selection, request);
  GEM_RETURN_IF_ERROR(stubs_->Call(*stubs_->tile, &v1::TileService::Stub::GetLocalMap,
                                   options_.deadline_s, request, response));
  return DecodeLocalMap(response.local_map(), selection);
}

}  // namespace gem::client
