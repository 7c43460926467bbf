#include "server/map_service.h"

#include <memory>
#include <string>
#include <vector>

#include "core/base/status_macros.h"
#include "proto/wire/map.h"
#include "proto/wire/scalar.h"
#include "proto/wire/session_setup.h"
#include "server/map_listing.h"
#include "server/server_status.h"

namespace gem {
namespace {

absl::Status CheckMapRequest(const std::string& map, const std::string& request_id) {
  GEM_RETURN_IF_ERROR(wire::CheckId(map, wire::FieldPath("map")));
  return wire::CheckRequestId(request_id, wire::FieldPath("request_id"));
}

absl::Status CreateMap(Registry& registry, const v1::CreateMapRequest& request,
                       v1::CreateMapResponse* response) {
  GEM_RETURN_IF_ERROR(CheckMapRequest(request.map(), request.request_id()));
  GEM_ASSIGN_OR_RETURN(const wire::MapSetup setup,
                       wire::FromProto(request.setup(), wire::FieldPath("setup")));
  const absl::StatusOr<std::shared_ptr<MapActor>> map =
      registry.CreateMap(request.map(), setup, request.request_id());
  if (!map.ok()) return map.status();
  MapToProto(**map, response->mutable_map());
  return absl::OkStatus();
}

absl::Status DeleteMap(Registry& registry, const v1::DeleteMapRequest& request) {
  GEM_RETURN_IF_ERROR(CheckMapRequest(request.map(), request.request_id()));
  return registry.DeleteMap(request.map(), request.request_id(), request.force());
}

void RetractSession(const Registry& registry, const v1::RetractSessionRequest& request,
                    v1::RetractSessionResponse* response, GuardedCall* call) {
  absl::Status checked = CheckMapRequest(request.map(), request.request_id());
  if (checked.ok()) checked = wire::CheckId(request.session(), wire::FieldPath("session"));
  if (!checked.ok()) return call->Complete(checked);
  const absl::StatusOr<std::shared_ptr<MapActor>> map = registry.FindMap(request.map());
  if (!map.ok()) return call->Complete(map.status());
  (*map)->Retract(request.session(), request.request_id(), request.restore(),
                  [call, response](const absl::StatusOr<RetractionAnswer>& answer) {
                    if (!answer.ok()) return call->Complete(answer.status());
                    wire::ToProto(answer->version, response->mutable_version());
                    response->set_num_submaps(answer->counts.num_submaps);
                    response->set_num_merged_points(answer->counts.num_merged_cells);
                    response->set_num_touched_tiles(answer->num_touched_tiles);
                    call->Complete(absl::OkStatus());
                  });
}

}  // namespace

MapService::MapService(Registry& registry, const ServerOptions& options, Metrics& metrics,
                       CallGuard& guard, CallGuard& admin_guard)
    : registry_(registry),
      options_(options),
      metrics_(metrics),
      guard_(guard),
      admin_guard_(admin_guard),
      create_map_(metrics.AddMethod("CreateMap")),
      delete_map_(metrics.AddMethod("DeleteMap")),
      get_map_(metrics.AddMethod("GetMap")),
      list_maps_(metrics.AddMethod("ListMaps")),
      list_submaps_(metrics.AddMethod("ListSubmaps")),
      list_sessions_(metrics.AddMethod("ListSessions")),
      retract_session_(metrics.AddMethod("RetractSession")),
      get_server_status_(metrics.AddMethod("GetServerStatus")) {}

grpc::ServerUnaryReactor* MapService::CreateMap(grpc::CallbackServerContext* context,
                                                const v1::CreateMapRequest* request,
                                                v1::CreateMapResponse* response) {
  return guard_.RunInPool(context, {request, response}, create_map_,
                          [=, this] { return gem::CreateMap(registry_, *request, response); });
}

grpc::ServerUnaryReactor* MapService::DeleteMap(grpc::CallbackServerContext* context,
                                                const v1::DeleteMapRequest* request,
                                                v1::DeleteMapResponse* response) {
  return admin_guard_.RunInPool(context, {request, response}, delete_map_,
                                [=, this] { return gem::DeleteMap(registry_, *request); });
}

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

grpc::ServerUnaryReactor* MapService::ListSessions(grpc::CallbackServerContext* context,
                                                   const v1::ListSessionsRequest* request,
                                                   v1::ListSessionsResponse* response) {
  return guard_.RunInPool(context, {request, response}, list_sessions_,
                          [=, this] { return gem::ListSessions(registry_, *request, response); });
}

grpc::ServerUnaryReactor* MapService::RetractSession(grpc::CallbackServerContext* context,
                                                     const v1::RetractSessionRequest* request,
                                                     v1::RetractSessionResponse* response) {
  return guard_.RunAsync(
      context, {request, response}, retract_session_,
      [=, this](GuardedCall* call) { gem::RetractSession(registry_, *request, response, call); });
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
