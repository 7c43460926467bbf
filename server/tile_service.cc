#include "server/tile_service.h"

#include <algorithm>
#include <memory>
#include <optional>
#include <vector>

#include "absl/strings/str_cat.h"
#include "core/base/status_macros.h"
#include "proto/wire/map.h"
#include "proto/wire/refusal.h"
#include "proto/wire/scalar.h"
#include "server/find_snapshot.h"

namespace gem {
namespace {

constexpr int kTilesOfRequest_max = 64;

template <typename Request>
std::vector<int> LayersOf(const Request& request) {
  return {request.layers().begin(), request.layers().end()};
}

absl::Status GetTileMatrix(const Registry& registry, const v1::GetTileMatrixRequest& request,
                           v1::GetTileMatrixResponse* response) {
  const auto snapshot = FindSnapshot(registry, request.map(), std::nullopt);
  if (!snapshot.ok()) return snapshot.status();
  const MapSnapshot& map = **snapshot;
  response->set_cell_size_m(map.options.cell_size_m);
  response->set_tile_cells(kTileCells);
  response->set_traversability_free(map.options.traversability_free);
  for (const Layer layer : wire::TileLayers())
    response->add_layers(static_cast<v1::Layer>(wire::ToProto(layer)));
  std::vector<TileIndex> tiles;
  tiles.reserve(map.tiles.size());
  for (const auto& [index, tile] : map.tiles) tiles.push_back(index);
  std::sort(tiles.begin(), tiles.end(),
            [](TileIndex a, TileIndex b) { return a.y != b.y ? a.y < b.y : a.x < b.x; });
  for (const TileIndex tile : tiles) wire::ToProto(TileAddress{0, tile}, response->add_tiles());
  wire::ToProto(map.version, response->mutable_version());
  return absl::OkStatus();
}

absl::Status BatchGetTiles(const Registry& registry, Metrics& metrics,
                           const v1::BatchGetTilesRequest& request,
                           v1::BatchGetTilesResponse* response) {
  const wire::FieldPath tiles_field("tiles");
  if (request.tiles_size() < 1 || request.tiles_size() > kTilesOfRequest_max)
    return wire::Refuse(tiles_field, absl::StrCat(request.tiles_size(), " tiles"),
                        absl::StrCat("1 to ", kTilesOfRequest_max));
  GEM_ASSIGN_OR_RETURN(
      const std::vector<Layer> layers,
      wire::LayersFromProto(LayersOf(request), wire::TileLayers(), wire::FieldPath("layers")));
  GEM_ASSIGN_OR_RETURN(const wire::CellEncoding encoding,
                       wire::EncodingFromProto(request.encoding(), wire::FieldPath("encoding")));
  std::optional<MapVersion> at;
  if (request.has_at()) at = wire::FromProto(request.at());
  const auto snapshot = FindSnapshot(registry, request.map(), at);
  if (!snapshot.ok()) return snapshot.status();
  const MapSnapshot& map = **snapshot;
  std::uint64_t num_absent = 0;
  for (int i = 0; i < request.tiles_size(); ++i) {
    const wire::FieldPath element = tiles_field.At(static_cast<std::size_t>(i));
    GEM_ASSIGN_OR_RETURN(const TileAddress address, wire::FromProto(request.tiles(i), element));
    v1::Tile* proto = response->add_tiles();
    const TileMap& tiles = map.TilesOf(address.level);
    const auto tile = tiles.find(address.index);
    if (tile == tiles.end()) {
      wire::ToProto(address, proto->mutable_key());
      wire::ToProto(map.version, proto->mutable_version());
      proto->set_absent(true);
      ++num_absent;
    } else {
      wire::ToProto(*tile->second, map.options.cell_size_m, layers, encoding, proto);
    }
  }
  metrics.CountTiles(static_cast<std::uint64_t>(request.tiles_size()) - num_absent, num_absent);
  wire::ToProto(map.version, response->mutable_version());
  return absl::OkStatus();
}

/// T_G_O of a session as the published map has it; of its opening before it is published.
Pose<Global, Odom> MapFromOdomOf(const SessionActor& session) {
  const std::shared_ptr<const MapSnapshot> map = session.map()->snapshot();
  for (const SessionInfo& info : map->sessions)
    if (info.session == session.config().setup.session) return info.T_G_O;
  return session.config().setup.T_G_O;
}

absl::Status GetLocalMap(const Registry& registry, const v1::GetLocalMapRequest& request,
                         v1::GetLocalMapResponse* response) {
  const wire::FieldPath robot_field("robot");
  GEM_RETURN_IF_ERROR(wire::CheckId(request.robot(), robot_field));
  GEM_ASSIGN_OR_RETURN(
      const std::vector<Layer> layers,
      wire::LayersFromProto(LayersOf(request), wire::LocalMapLayers(), wire::FieldPath("layers")));
  GEM_ASSIGN_OR_RETURN(const wire::CellEncoding encoding,
                       wire::EncodingFromProto(request.encoding(), wire::FieldPath("encoding")));
  const absl::StatusOr<std::shared_ptr<SessionActor>> session = registry.FindRobot(request.robot());
  if (!session.ok()) return session.status();
  const std::shared_ptr<const LocalMap> map = (*session)->local_map();
  if (map == nullptr)
    return wire::WithField(
        absl::NotFoundError(absl::StrCat("robot is ", request.robot(),
                                         ", of which no scan is fused yet, want one with a map")),
        "robot");
  wire::ToProto(*map, {MapFromOdomOf(**session), (*session)->config().setup.session}, layers,
                encoding, response->mutable_local_map());
  return absl::OkStatus();
}

}  // namespace

TileService::TileService(Registry& registry, Metrics& metrics, CallGuard& guard)
    : registry_(registry),
      metrics_(metrics),
      guard_(guard),
      get_tile_matrix_(metrics.AddMethod("GetTileMatrix")),
      batch_get_tiles_(metrics.AddMethod("BatchGetTiles")),
      get_local_map_(metrics.AddMethod("GetLocalMap")) {}

grpc::ServerUnaryReactor* TileService::GetTileMatrix(grpc::CallbackServerContext* context,
                                                     const v1::GetTileMatrixRequest* request,
                                                     v1::GetTileMatrixResponse* response) {
  return guard_.RunInPool(context, {request, response}, get_tile_matrix_,
                          [=, this] { return gem::GetTileMatrix(registry_, *request, response); });
}

grpc::ServerUnaryReactor* TileService::BatchGetTiles(grpc::CallbackServerContext* context,
                                                     const v1::BatchGetTilesRequest* request,
                                                     v1::BatchGetTilesResponse* response) {
  return guard_.RunInPool(context, {request, response}, batch_get_tiles_, [=, this] {
    return gem::BatchGetTiles(registry_, metrics_, *request, response);
  });
}

grpc::ServerUnaryReactor* TileService::GetLocalMap(grpc::CallbackServerContext* context,
                                                   const v1::GetLocalMapRequest* request,
                                                   v1::GetLocalMapResponse* response) {
  return guard_.RunInPool(context, {request, response}, get_local_map_,
                          [=, this] { return gem::GetLocalMap(registry_, *request, response); });
}

}  // namespace gem
