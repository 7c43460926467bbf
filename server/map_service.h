// gem.v1.MapService: maps, submaps, sessions and timings. What the lists answer is in
// map_listing.h.
#pragma once

#include <chrono>

#include "gem/v1/map_service.grpc.pb.h"
#include "server/call_guard.h"
#include "server/reader_stream.h"
#include "server/registry.h"
#include "server/transfer_slots.h"
#include "server/turn_scheduler.h"
#include "server/worker_pool.h"

namespace gem {

/// A file goes out in bytes that gRPC need not write.
using MapServiceBase =
    v1::MapService::WithRawCallbackMethod_ExportMap<v1::MapService::CallbackService>;

class MapService final : public MapServiceBase {
 public:
  /// Everything outlives the service. admin_pool: for what may take long or wait for threads.
  MapService(Registry& registry, const ServerOptions& options, TurnScheduler& readers,
             Metrics& metrics, CallGuard& guard, WorkerPool& admin_pool);

  grpc::ServerUnaryReactor* CreateMap(grpc::CallbackServerContext* context,
                                      const v1::CreateMapRequest* request,
                                      v1::CreateMapResponse* response) override;
  grpc::ServerUnaryReactor* DeleteMap(grpc::CallbackServerContext* context,
                                      const v1::DeleteMapRequest* request,
                                      v1::DeleteMapResponse* response) override;
  grpc::ServerUnaryReactor* GetMap(grpc::CallbackServerContext* context,
                                   const v1::GetMapRequest* request,
                                   v1::GetMapResponse* response) override;
  grpc::ServerUnaryReactor* ListMaps(grpc::CallbackServerContext* context,
                                     const v1::ListMapsRequest* request,
                                     v1::ListMapsResponse* response) override;
  grpc::ServerUnaryReactor* ListSubmaps(grpc::CallbackServerContext* context,
                                        const v1::ListSubmapsRequest* request,
                                        v1::ListSubmapsResponse* response) override;
  grpc::ServerUnaryReactor* ListSessions(grpc::CallbackServerContext* context,
                                         const v1::ListSessionsRequest* request,
                                         v1::ListSessionsResponse* response) override;
  grpc::ServerUnaryReactor* RetractSession(grpc::CallbackServerContext* context,
                                           const v1::RetractSessionRequest* request,
                                           v1::RetractSessionResponse* response) override;
  grpc::ServerWriteReactor<grpc::ByteBuffer>* ExportMap(grpc::CallbackServerContext* context,
                                                        const grpc::ByteBuffer* request) override;
  grpc::ServerReadReactor<v1::ImportMapRequest>* ImportMap(
      grpc::CallbackServerContext* context, v1::ImportMapResponse* response) override;
  grpc::ServerUnaryReactor* GetServerStatus(grpc::CallbackServerContext* context,
                                            const v1::GetServerStatusRequest* request,
                                            v1::GetServerStatusResponse* response) override;

 private:
  Registry& registry_;
  const ServerOptions& options_;
  TurnScheduler& readers_;
  Metrics& metrics_;
  CallGuard& guard_;
  WorkerPool& admin_pool_;
  CallGuard admin_guard_;
  TransferSlots transfers_;
  MethodMetrics& create_map_;
  MethodMetrics& delete_map_;
  MethodMetrics& get_map_;
  MethodMetrics& list_maps_;
  MethodMetrics& list_submaps_;
  MethodMetrics& list_sessions_;
  MethodMetrics& retract_session_;
  MethodMetrics& export_map_;
  MethodMetrics& import_map_;
  MethodMetrics& get_server_status_;
  const std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

}  // namespace gem
