#include "server/map_service.h"

#include <memory>
#include <string>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "core/base/status_macros.h"
#include "proto/wire/map.h"
#include "proto/wire/refusal.h"
#include "proto/wire/scalar.h"
#include "server/server_status.h"

namespace gem {
namespace {

constexpr std::uint32_t kPageSizeDefault = 100;
constexpr std::uint32_t kPageSizeMax = 1000;

absl::StatusOr<std::size_t> PageSize(std::uint32_t page_size) {
  if (page_size > kPageSizeMax)
    return wire::Refuse(wire::FieldPath("page_size"), absl::StrCat(page_size),
                        absl::StrCat("at most ", kPageSizeMax));
  return page_size == 0 ? kPageSizeDefault : page_size;
}

absl::Status RefusePageToken() {
  // Not repeated: it is the caller's and may be long.
  return wire::Refuse(wire::FieldPath("page_token"), "not one of this server's",
                      "next_page_token of the page before");
}

void MapToProto(const MapActor& actor, v1::Map* proto) {
  const std::shared_ptr<const MapSnapshot> map = actor.snapshot();
  proto->set_id(actor.id());
  proto->set_cell_size_m(map->options.cell_size_m);
  proto->set_submap_length_m(map->options.submap_length_m);
  proto->set_traversable_only(map->options.traversable_only);
  wire::ToProto(map->version, proto->mutable_version());
  proto->set_num_submaps(map->submaps.size());
  proto->set_num_points(map->num_points);
  proto->set_submap_bytes(map->submap_bytes);
  proto->set_num_tiles(map->tiles.size());
  for (std::string& session : actor.sessions()) proto->add_sessions(std::move(session));
}

absl::Status GetMap(const Registry& registry, const v1::GetMapRequest& request,
                    v1::GetMapResponse* response) {
  GEM_RETURN_IF_ERROR(wire::CheckId(request.map(), wire::FieldPath("map")));
  const absl::StatusOr<std::shared_ptr<MapActor>> map = registry.FindMap(request.map());
  if (!map.ok()) return map.status();
  MapToProto(**map, response->mutable_map());
  return absl::OkStatus();
}

absl::Status ListMaps(const Registry& registry, const v1::ListMapsRequest& request,
                      v1::ListMapsResponse* response) {
  GEM_ASSIGN_OR_RETURN(const std::size_t page_size, PageSize(request.page_size()));
  const std::string& after = request.page_token();
  if (!after.empty() && !wire::CheckId(after, wire::FieldPath("page_token")).ok())
    return RefusePageToken();
  // The token is the last id of the page before: maps that come and go in between shift nothing.
  for (const std::shared_ptr<MapActor>& map : registry.Maps()) {
    if (!after.empty() && map->id() <= after) continue;
    if (static_cast<std::size_t>(response->maps_size()) == page_size) {
      response->set_next_page_token(response->maps(response->maps_size() - 1).id());
      break;
    }
    MapToProto(*map, response->add_maps());
  }
  return absl::OkStatus();
}

absl::Status ListSubmaps(const Registry& registry, const v1::ListSubmapsRequest& request,
                         v1::ListSubmapsResponse* response) {
  GEM_RETURN_IF_ERROR(wire::CheckId(request.map(), wire::FieldPath("map")));
  GEM_ASSIGN_OR_RETURN(const std::size_t page_size, PageSize(request.page_size()));
  std::uint64_t after = 0;
  const bool first_page = request.page_token().empty();
  if (!first_page && !absl::SimpleAtoi(request.page_token(), &after)) return RefusePageToken();
  const absl::StatusOr<std::shared_ptr<MapActor>> map = registry.FindMap(request.map());
  if (!map.ok()) return map.status();
  const std::shared_ptr<const MapSnapshot> snapshot = (*map)->snapshot();
  for (const SubmapInfo& submap : snapshot->submaps) {
    if (!first_page && static_cast<std::uint64_t>(submap.origin.id) <= after) continue;
    if (static_cast<std::size_t>(response->submaps_size()) == page_size) {
      response->set_next_page_token(
          absl::StrCat(response->submaps(response->submaps_size() - 1).id()));
      break;
    }
    wire::ToProto(submap, response->add_submaps());
  }
  wire::ToProto(snapshot->version, response->mutable_version());
  return absl::OkStatus();
}

}  // namespace

MapService::MapService(Registry& registry, const ServerOptions& options, Metrics& metrics,
                       CallGuard& guard)
    : registry_(registry),
      options_(options),
      metrics_(metrics),
      guard_(guard),
      get_map_(metrics.AddMethod("GetMap")),
      list_maps_(metrics.AddMethod("ListMaps")),
      list_submaps_(metrics.AddMethod("ListSubmaps")),
      get_server_status_(metrics.AddMethod("GetServerStatus")) {}

grpc::ServerUnaryReactor* MapService::GetMap(grpc::CallbackServerContext* context,
                                             const v1::GetMapRequest* request,
                                             v1::GetMapResponse* response) {
  return guard_.Run(context, {request, response}, get_map_,
                    [&] { return gem::GetMap(registry_, *request, response); });
}

grpc::ServerUnaryReactor* MapService::ListMaps(grpc::CallbackServerContext* context,
                                               const v1::ListMapsRequest* request,
                                               v1::ListMapsResponse* response) {
  return guard_.RunInPool(context, {request, response}, list_maps_,
                          [=, this] { return gem::ListMaps(registry_, *request, response); });
}

grpc::ServerUnaryReactor* MapService::ListSubmaps(grpc::CallbackServerContext* context,
                                                  const v1::ListSubmapsRequest* request,
                                                  v1::ListSubmapsResponse* response) {
  return guard_.RunInPool(context, {request, response}, list_submaps_,
                          [=, this] { return gem::ListSubmaps(registry_, *request, response); });
}

grpc::ServerUnaryReactor* MapService::GetServerStatus(grpc::CallbackServerContext* context,
                                                      const v1::GetServerStatusRequest* request,
                                                      v1::GetServerStatusResponse* response) {
  return guard_.RunInPool(context, {request, response}, get_server_status_, [=, this] {
    response->set_server_version(GEM_VERSION);
    response->set_backend(std::string(NameOf(options_.backend)));
    response->set_uptime_s(
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count());
    StatusToProto(registry_, metrics_, response);
    return absl::OkStatus();
  });
}

}  // namespace gem
