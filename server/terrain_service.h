// gem.v1.TerrainService: questions about the ground of the global map.
#pragma once

#include "gem/v1/terrain_service.grpc.pb.h"
#include "server/call_guard.h"
#include "server/registry.h"

namespace gem {

class TerrainService final : public v1::TerrainService::CallbackService {
 public:
  /// Everything outlives the service.
  TerrainService(Registry& registry, Metrics& metrics, CallGuard& guard);

  grpc::ServerUnaryReactor* SampleHeights(grpc::CallbackServerContext* context,
                                          const v1::SampleHeightsRequest* request,
                                          v1::SampleHeightsResponse* response) override;
  grpc::ServerUnaryReactor* CheckPath(grpc::CallbackServerContext* context,
                                      const v1::CheckPathRequest* request,
                                      v1::CheckPathResponse* response) override;

 private:
  Registry& registry_;
  CallGuard& guard_;
  MethodMetrics& sample_heights_;
  MethodMetrics& check_path_;
};

}  // namespace gem
