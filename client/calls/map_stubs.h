// How MapClient reaches the services. Private to the library: the one header of it that shows gRPC.
#pragma once

#include <grpcpp/grpcpp.h>

#include <chrono>
#include <memory>
#include <string>

#include "absl/status/status.h"
#include "client/call_status.h"
#include "client/connection.h"
#include "client/map_client.h"
#include "gem/v1/ingest_service.grpc.pb.h"
#include "gem/v1/map_service.grpc.pb.h"
#include "gem/v1/terrain_service.grpc.pb.h"
#include "gem/v1/tile_service.grpc.pb.h"

namespace gem::client {

struct MapClient::Stubs {
  explicit Stubs(const Connection& connection)
      : map(v1::MapService::NewStub(connection.channel())),
        tile(v1::TileService::NewStub(connection.channel())),
        ingest(v1::IngestService::NewStub(connection.channel())),
        terrain(v1::TerrainService::NewStub(connection.channel())),
        address(connection.address()) {}

  static void SetDeadline(grpc::ClientContext& context, double deadline_s) {
    context.set_deadline(std::chrono::system_clock::now() +
                         std::chrono::duration_cast<std::chrono::system_clock::duration>(
                             std::chrono::duration<double>(deadline_s)));
  }

  /// Makes one call: `(stub->*method)(context, request, response)`.
  template <typename Stub, typename Request, typename Response>
  absl::Status Call(Stub& stub,
                    grpc::Status (Stub::*method)(grpc::ClientContext*, const Request&, Response*),
                    double deadline_s, const Request& request, Response& response) const {
    grpc::ClientContext context;
    SetDeadline(context, deadline_s);
    return ToStatus((stub.*method)(&context, request, &response), address);
  }

  const std::unique_ptr<v1::MapService::Stub> map;
  const std::unique_ptr<v1::TileService::Stub> tile;
  const std::unique_ptr<v1::IngestService::Stub> ingest;
  const std::unique_ptr<v1::TerrainService::Stub> terrain;
  const std::string address;
};

MapInfo MapInfoOf(const v1::Map& proto);

}  // namespace gem::client
