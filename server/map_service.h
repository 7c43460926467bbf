// gem.v1.MapService: maps, submaps, sessions and timings. What the lists answer is in
// map_listing.h.
#pragma once

#include <chrono>

#include "gem/v1/map_service.grpc.pb.h"
#include "server/call_guard.h"
#include "server/registry.h"

namespace gem {

class MapService final : public v1::MapService::CallbackService {
 public:
  /// Everything outlives the service. admin_guard: for what may take long or wait for threads.
  MapService(Registry& registry, const ServerOptions& options, Metrics& metrics, CallGuard& guard,
             CallGuard& admin_guard);

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
  grpc::ServerUnaryReactor* GetServerStatus(grpc::CallbackServerContext* context,
                                            const v1::GetServerStatusRequest* request,
                                            v1::GetServerStatusResponse* response) override;

 private:
  Registry& registry_;
  const ServerOptions& options_;
  Metrics& metrics_;
  CallGuard& guard_;
  CallGuard& admin_guard_;
  MethodMetrics& create_map_;
  MethodMetrics& delete_map_;
  MethodMetrics& get_map_;
  MethodMetrics& list_maps_;
  MethodMetrics& list_submaps_;
  MethodMetrics& list_sessions_;
  MethodMetrics& retract_session_;
  MethodMetrics& get_server_status_;
  const std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

}  // namespace gem
