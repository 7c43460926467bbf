// gem.v1.MapService: maps, submaps, sessions and timings.
#pragma once

#include <chrono>

#include "gem/v1/map_service.grpc.pb.h"
#include "server/call_guard.h"
#include "server/registry.h"

namespace gem {

class MapService final : public v1::MapService::CallbackService {
 public:
  /// Everything outlives the service.
  MapService(Registry& registry, const ServerOptions& options, Metrics& metrics, CallGuard& guard);

  grpc::ServerUnaryReactor* GetMap(grpc::CallbackServerContext* context,
                                   const v1::GetMapRequest* request,
                                   v1::GetMapResponse* response) override;
  grpc::ServerUnaryReactor* ListMaps(grpc::CallbackServerContext* context,
                                     const v1::ListMapsRequest* request,
                                     v1::ListMapsResponse* response) override;
  grpc::ServerUnaryReactor* ListSubmaps(grpc::CallbackServerContext* context,
                                        const v1::ListSubmapsRequest* request,
                                        v1::ListSubmapsResponse* response) override;
  grpc::ServerUnaryReactor* GetServerStatus(grpc::CallbackServerContext* context,
                                            const v1::GetServerStatusRequest* request,
                                            v1::GetServerStatusResponse* response) override;

 private:
  Registry& registry_;
  const ServerOptions& options_;
  Metrics& metrics_;
  CallGuard& guard_;
  MethodMetrics& get_map_;
  MethodMetrics& list_maps_;
  MethodMetrics& list_submaps_;
  MethodMetrics& get_server_status_;
  const std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

}  // namespace gem
