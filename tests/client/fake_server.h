// A server in this process whose answers a test scripts: what the client library is tested against.
#pragma once

#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>

#include <atomic>
#include <functional>
#include <memory>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "client/connection.h"
#include "gem/v1/ingest_service.grpc.pb.h"
#include "gem/v1/map_service.grpc.pb.h"
#include "gem/v1/terrain_service.grpc.pb.h"
#include "gem/v1/tile_service.grpc.pb.h"

namespace gem::client {

using ServerStream = grpc::ServerReaderWriter<v1::IngestResponse, v1::IngestRequest>;

template <typename Request, typename Response>
using Handler = std::function<grpc::Status(const Request&, Response&)>;

class FakeIngestService : public v1::IngestService::Service {
 public:
  /// Plays stream number 1, 2, ...; its status ends the stream.
  std::function<grpc::Status(int stream_number, ServerStream& stream)> on_ingest;
  Handler<v1::CorrectTrajectoryRequest, v1::CorrectTrajectoryResponse> on_correct;
  std::atomic<int> num_streams{0};

  grpc::Status Ingest(grpc::ServerContext*, ServerStream* stream) override {
    return on_ingest(++num_streams, *stream);
  }
  grpc::Status CorrectTrajectory(grpc::ServerContext*, const v1::CorrectTrajectoryRequest* request,
                                 v1::CorrectTrajectoryResponse* response) override {
    return on_correct(*request, *response);
  }
};

class FakeTileService : public v1::TileService::Service {
 public:
  Handler<v1::GetTileMatrixRequest, v1::GetTileMatrixResponse> on_matrix;
  Handler<v1::BatchGetTilesRequest, v1::BatchGetTilesResponse> on_tiles;
  Handler<v1::GetLocalMapRequest, v1::GetLocalMapResponse> on_local_map;
  /// Play stream number 1, 2, ...; their status ends the stream.
  std::function<grpc::Status(int stream_number, const v1::WatchTilesRequest& request,
                             grpc::ServerContext& context,
                             grpc::ServerWriter<v1::WatchTilesResponse>& stream)>
      on_watch;
  std::function<grpc::Status(int stream_number, const v1::WatchLocalMapRequest& request,
                             grpc::ServerContext& context,
                             grpc::ServerWriter<v1::WatchLocalMapResponse>& stream)>
      on_watch_local_map;
  std::atomic<int> num_watches{0};

  grpc::Status GetTileMatrix(grpc::ServerContext*, const v1::GetTileMatrixRequest* request,
                             v1::GetTileMatrixResponse* response) override {
    return on_matrix(*request, *response);
  }
  grpc::Status BatchGetTiles(grpc::ServerContext*, const v1::BatchGetTilesRequest* request,
                             v1::BatchGetTilesResponse* response) override {
    return on_tiles(*request, *response);
  }
  grpc::Status GetLocalMap(grpc::ServerContext*, const v1::GetLocalMapRequest* request,
                           v1::GetLocalMapResponse* response) override {
    return on_local_map(*request, *response);
  }
  grpc::Status WatchTiles(grpc::ServerContext* context, const v1::WatchTilesRequest* request,
                          grpc::ServerWriter<v1::WatchTilesResponse>* stream) override {
    return on_watch(++num_watches, *request, *context, *stream);
  }
  grpc::Status WatchLocalMap(grpc::ServerContext* context, const v1::WatchLocalMapRequest* request,
                             grpc::ServerWriter<v1::WatchLocalMapResponse>* stream) override {
    return on_watch_local_map(++num_watches, *request, *context, *stream);
  }
};

class FakeMapService : public v1::MapService::Service {
 public:
  Handler<v1::GetMapRequest, v1::GetMapResponse> on_map;
  Handler<v1::ListMapsRequest, v1::ListMapsResponse> on_maps;
  Handler<v1::ListSubmapsRequest, v1::ListSubmapsResponse> on_submaps;
  Handler<v1::GetServerStatusRequest, v1::GetServerStatusResponse> on_status;

  grpc::Status GetMap(grpc::ServerContext*, const v1::GetMapRequest* request,
                      v1::GetMapResponse* response) override {
    return on_map(*request, *response);
  }
  grpc::Status ListMaps(grpc::ServerContext*, const v1::ListMapsRequest* request,
                        v1::ListMapsResponse* response) override {
    return on_maps(*request, *response);
  }
  grpc::Status ListSubmaps(grpc::ServerContext*, const v1::ListSubmapsRequest* request,
                           v1::ListSubmapsResponse* response) override {
    return on_submaps(*request, *response);
  }
  grpc::Status GetServerStatus(grpc::ServerContext*, const v1::GetServerStatusRequest* request,
                               v1::GetServerStatusResponse* response) override {
    return on_status(*request, *response);
  }
};

class FakeTerrainService : public v1::TerrainService::Service {
 public:
  Handler<v1::SampleHeightsRequest, v1::SampleHeightsResponse> on_heights;
  Handler<v1::CheckPathRequest, v1::CheckPathResponse> on_path;

  grpc::Status SampleHeights(grpc::ServerContext*, const v1::SampleHeightsRequest* request,
                             v1::SampleHeightsResponse* response) override {
    return on_heights(*request, *response);
  }
  grpc::Status CheckPath(grpc::ServerContext*, const v1::CheckPathRequest* request,
                         v1::CheckPathResponse* response) override {
    return on_path(*request, *response);
  }
};

/// Script the services before the first call.
class FakeServer {
 public:
  FakeServer() {
    grpc::ServerBuilder builder;
    int port = 0;
    builder.AddListeningPort("127.0.0.1:0", grpc::InsecureServerCredentials(), &port);
    builder.RegisterService(&ingest);
    builder.RegisterService(&tile);
    builder.RegisterService(&map);
    builder.RegisterService(&terrain);
    server_ = builder.BuildAndStart();
    EXPECT_NE(server_, nullptr);
    address_ = absl::StrCat("127.0.0.1:", port);
  }
  ~FakeServer() { Stop(); }

  /// Cancels what runs; no handler runs after it. For handlers that use locals of the test.
  void Stop() {
    server_->Shutdown(std::chrono::system_clock::now());
    server_->Wait();
  }

  const std::string& address() const { return address_; }
  std::shared_ptr<const Connection> Connect() const {
    ConnectionOptions options;
    options.address = address_;
    return std::make_shared<const Connection>(options);
  }

  FakeIngestService ingest;
  FakeTileService tile;
  FakeMapService map;
  FakeTerrainService terrain;

 private:
  std::unique_ptr<grpc::Server> server_;
  std::string address_;
};

/// Reads the opening message and answers it.
inline v1::OpenSession AnswerOpen(ServerStream& stream, std::uint64_t resume_after_seq,
                                  std::uint64_t credit_bytes = 1 << 20,
                                  std::uint64_t scan_bytes_max = 1 << 20) {
  v1::IngestRequest request;
  EXPECT_TRUE(stream.Read(&request));
  EXPECT_TRUE(request.has_open());
  v1::IngestResponse response;
  response.mutable_opened()->set_resume_after_seq(resume_after_seq);
  response.mutable_opened()->set_credit_bytes(credit_bytes);
  response.mutable_opened()->set_scan_bytes_max(scan_bytes_max);
  response.mutable_opened()->set_cell_size_m(0.25f);
  response.mutable_opened()->set_local_map_side_m(8);
  stream.Write(response);
  return request.open();
}

/// The next message, which must be a scan; nothing if the stream ends.
inline v1::Scan ReadScan(ServerStream& stream) {
  v1::IngestRequest request;
  EXPECT_TRUE(stream.Read(&request));
  EXPECT_TRUE(request.has_scan()) << request.ShortDebugString();
  return request.scan();
}

inline void Acknowledge(ServerStream& stream, std::uint64_t accepted_seq, std::uint64_t fused_seq,
                        std::uint64_t credit_bytes = 0) {
  v1::IngestResponse response;
  response.mutable_ack()->set_accepted_seq(accepted_seq);
  response.mutable_ack()->set_fused_seq(fused_seq);
  response.mutable_ack()->set_credit_bytes(credit_bytes);
  stream.Write(response);
}

/// Reads the closing message and answers it.
inline grpc::Status AnswerClose(ServerStream& stream, std::uint64_t revision) {
  v1::IngestRequest request;
  EXPECT_TRUE(stream.Read(&request));
  EXPECT_TRUE(request.has_close()) << request.ShortDebugString();
  v1::IngestResponse response;
  response.mutable_closed()->mutable_version()->set_epoch(5);
  response.mutable_closed()->mutable_version()->set_revision(revision);
  stream.Write(response);
  return grpc::Status::OK;
}

}  // namespace gem::client
