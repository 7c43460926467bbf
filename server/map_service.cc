#include "server/map_service.h"

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "core/base/status_macros.h"
#include "proto/wire/map.h"
#include "proto/wire/scalar.h"
#include "proto/wire/session_setup.h"
#include "server/byte_buffer.h"
#include "server/import_reactor.h"
#include "server/map_export.h"
#include "server/map_import.h"
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

absl::StatusOr<std::unique_ptr<MapExport>> OpenExport(const Registry& registry,
                                                      const grpc::ByteBuffer& bytes,
                                                      TransferSlots& transfers,
                                                      TurnScheduler& readers) {
  GEM_ASSIGN_OR_RETURN(const v1::ExportMapRequest request, Parse<v1::ExportMapRequest>(bytes));
  GEM_RETURN_IF_ERROR(wire::CheckId(request.map(), wire::FieldPath("map")));
  const absl::StatusOr<std::shared_ptr<MapActor>> map = registry.FindMap(request.map());
  if (!map.ok()) return map.status();
  GEM_ASSIGN_OR_RETURN(std::unique_ptr<TransferSlots::Slot> slot, transfers.Take());
  return std::make_unique<MapExport>(**map, std::move(slot), &readers);
}

}  // namespace

MapService::MapService(Registry& registry, const ServerOptions& options, TurnScheduler& readers,
                       Metrics& metrics, CallGuard& guard, WorkerPool& admin_pool)
    : registry_(registry),
      options_(options),
      readers_(readers),
      metrics_(metrics),
      guard_(guard),
      admin_pool_(admin_pool),
      admin_guard_(admin_pool),
      transfers_(options.transfers_max),
      create_map_(metrics.AddMethod("CreateMap")),
      delete_map_(metrics.AddMethod("DeleteMap")),
      get_map_(metrics.AddMethod("GetMap")),
      list_maps_(metrics.AddMethod("ListMaps")),
      list_submaps_(metrics.AddMethod("ListSubmaps")),
      list_sessions_(metrics.AddMethod("ListSessions")),
      retract_session_(metrics.AddMethod("RetractSession")),
      export_map_(metrics.AddMethod("ExportMap")),
      import_map_(metrics.AddMethod("ImportMap")),
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

grpc::ServerWriteReactor<grpc::ByteBuffer>* MapService::ExportMap(
    grpc::CallbackServerContext* /*context*/, const grpc::ByteBuffer* request) {
  const auto stream = std::make_shared<ReaderStream>(readers_, export_map_);
  absl::StatusOr<std::unique_ptr<MapExport>> source =
      OpenExport(registry_, *request, transfers_, readers_);
  if (source.ok()) {
    const NewsSource news = (*source)->news();
    stream->Start(request->Length(), *std::move(source), news);
  } else {
    stream->Refuse(request->Length(), source.status());
  }
  return stream.get();  // keeps itself alive
}

grpc::ServerReadReactor<v1::ImportMapRequest>* MapService::ImportMap(
    grpc::CallbackServerContext* context, v1::ImportMapResponse* response) {
  return new ImportReactor(context, response, MapImport(registry_, options_, transfers_),
                           admin_pool_, import_map_);
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
