// gem.v1.TileService: tiles of the global map and robocentric maps out.
#pragma once

#include "gem/v1/tile_service.grpc.pb.h"
#include "server/call_guard.h"
#include "server/encoded_cache.h"
#include "server/reader_stream.h"
#include "server/registry.h"
#include "server/turn_scheduler.h"

namespace gem {

/// Where cells go out, messages are made of buffers that are shared: gRPC gets bytes.
using TileServiceBase = v1::TileService::WithCallbackMethod_GetTileMatrix<
    v1::TileService::WithRawCallbackMethod_BatchGetTiles<
        v1::TileService::WithRawCallbackMethod_StreamTiles<
            v1::TileService::WithRawCallbackMethod_WatchTiles<
                v1::TileService::WithRawCallbackMethod_GetLocalMap<
                    v1::TileService::WithRawCallbackMethod_WatchLocalMap<
                        v1::TileService::Service>>>>>>;

class TileService final : public TileServiceBase {
 public:
  /// Everything outlives the service.
  TileService(Registry& registry, EncodedCache& cache, TurnScheduler& readers, Metrics& metrics,
              CallGuard& guard);

  grpc::ServerUnaryReactor* GetTileMatrix(grpc::CallbackServerContext* context,
                                          const v1::GetTileMatrixRequest* request,
                                          v1::GetTileMatrixResponse* response) override;
  grpc::ServerUnaryReactor* BatchGetTiles(grpc::CallbackServerContext* context,
                                          const grpc::ByteBuffer* request,
                                          grpc::ByteBuffer* response) override;
  grpc::ServerWriteReactor<grpc::ByteBuffer>* StreamTiles(grpc::CallbackServerContext* context,
                                                          const grpc::ByteBuffer* request) override;
  grpc::ServerWriteReactor<grpc::ByteBuffer>* WatchTiles(grpc::CallbackServerContext* context,
                                                         const grpc::ByteBuffer* request) override;
  grpc::ServerUnaryReactor* GetLocalMap(grpc::CallbackServerContext* context,
                                        const grpc::ByteBuffer* request,
                                        grpc::ByteBuffer* response) override;
  grpc::ServerWriteReactor<grpc::ByteBuffer>* WatchLocalMap(
      grpc::CallbackServerContext* context, const grpc::ByteBuffer* request) override;

 private:
  /// What a stream of a request says, and whose news it waits for.
  struct Opening {
    std::unique_ptr<MessageSource> source;
    NewsSource news{};
  };
  absl::StatusOr<Opening> Open(const v1::StreamTilesRequest& proto);
  absl::StatusOr<Opening> Open(const v1::WatchTilesRequest& proto);
  absl::StatusOr<Opening> Open(const v1::WatchLocalMapRequest& proto);
  template <typename Request>
  ReaderStream* StartStream(const grpc::ByteBuffer& request, MethodMetrics& metrics);

  Registry& registry_;
  EncodedCache& cache_;
  TurnScheduler& readers_;
  Metrics& metrics_;
  CallGuard& guard_;
  MethodMetrics& get_tile_matrix_;
  MethodMetrics& batch_get_tiles_;
  MethodMetrics& stream_tiles_;
  MethodMetrics& watch_tiles_;
  MethodMetrics& get_local_map_;
  MethodMetrics& watch_local_map_;
};

}  // namespace gem
