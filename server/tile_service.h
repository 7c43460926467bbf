// gem.v1.TileService: tiles of the global map and robocentric maps out.
#pragma once

#include "gem/v1/tile_service.grpc.pb.h"
#include "server/call_guard.h"
#include "server/registry.h"

namespace gem {

class TileService final : public v1::TileService::CallbackService {
 public:
  /// Everything outlives the service.
  TileService(Registry& registry, Metrics& metrics, CallGuard& guard);

  grpc::ServerUnaryReactor* GetTileMatrix(grpc::CallbackServerContext* context,
                                          const v1::GetTileMatrixRequest* request,
                                          v1::GetTileMatrixResponse* response) override;
  grpc::ServerUnaryReactor* BatchGetTiles(grpc::CallbackServerContext* context,
                                          const v1::BatchGetTilesRequest* request,
                                          v1::BatchGetTilesResponse* response) override;
  grpc::ServerUnaryReactor* GetLocalMap(grpc::CallbackServerContext* context,
                                        const v1::GetLocalMapRequest* request,
                                        v1::GetLocalMapResponse* response) override;

 private:
  Registry& registry_;
  Metrics& metrics_;
  CallGuard& guard_;
  MethodMetrics& get_tile_matrix_;
  MethodMetrics& batch_get_tiles_;
  MethodMetrics& get_local_map_;
};

}  // namespace gem
