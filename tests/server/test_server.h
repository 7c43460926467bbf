// A server in the test's process and raw generated stubs to talk to it: what clients of any
// language see. Every call has a deadline, so that a test fails instead of hanging.
#pragma once

#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>

#include <chrono>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "gem/v1/ingest_service.grpc.pb.h"
#include "gem/v1/map_service.grpc.pb.h"
#include "gem/v1/terrain_service.grpc.pb.h"
#include "gem/v1/tile_service.grpc.pb.h"
#include "proto/wire/map.h"
#include "proto/wire/scan.h"
#include "server/server.h"

namespace gem {

inline std::chrono::system_clock::time_point TestDeadline() {
  return std::chrono::system_clock::now() + std::chrono::seconds(60);
}

inline ServerOptions TestOptions() {
  ServerOptions options;
  options.listen = "127.0.0.1:0";
  options.metrics_listen = "127.0.0.1:0";
  options.log_level = "warn";
  options.publish_hz = 50;
  options.map.cell_size_m = 0.5f;
  options.local_map.side_m = 8;
  return options;
}

/// Body of http://address/metrics.
std::string FetchMetrics(const std::string& address);
/// Value of a series, named as on the page; -1 if it is not there.
double MetricValue(const std::string& page, const std::string& series);

class TestServer {
 public:
  explicit TestServer(const ServerOptions& options = TestOptions());

  Server& server() { return *server_; }
  std::string address() const { return server_->grpc_address(); }
  /// On a connection of its own.
  std::shared_ptr<grpc::Channel> NewChannel() const;
  double Metric(const std::string& series) const {
    return MetricValue(FetchMetrics(server_->metrics_address()), series);
  }

  v1::IngestService::Stub& ingest() { return *ingest_; }
  v1::TileService::Stub& tiles() { return *tiles_; }
  v1::MapService::Stub& maps() { return *maps_; }
  v1::TerrainService::Stub& terrain() { return *terrain_; }

  /// One unary call with a deadline.
  template <typename Stub, typename Request, typename Response>
  static grpc::Status Call(Stub& stub,
                           grpc::Status (Stub::*method)(grpc::ClientContext*, const Request&,
                                                        Response*),
                           const Request& request, Response& response) {
    grpc::ClientContext context;
    context.set_deadline(TestDeadline());
    return (stub.*method)(&context, request, &response);
  }

 private:
  std::unique_ptr<Server> server_;
  std::unique_ptr<v1::IngestService::Stub> ingest_;
  std::unique_ptr<v1::TileService::Stub> tiles_;
  std::unique_ptr<v1::MapService::Stub> maps_;
  std::unique_ptr<v1::TerrainService::Stub> terrain_;
};

/// Map "site", the session given, one LiDAR "top" at the origin of B.
v1::OpenSession TestOpen(const std::string& robot, const std::string& session);

/// Flat ground at z = 0 of O, two points in each cell of the window around (x, y), seen from 1 m
/// above it. The stamp is seq times 0.1 s.
v1::Scan FlatScan(std::uint64_t seq, double x_m, double y_m = 0);
inline std::int64_t StampOf(std::uint64_t seq) {
  return static_cast<std::int64_t>(seq) * 100'000'000;
}

/// Poses 1 m over O of a robot that drives along x and is at x = 0 at stamp 0.
v1::PoseBatch PosesAt(const std::vector<double>& stamps_s, double speed_m_per_s = 0);

/// A robot's end of an Ingest stream.
class TestStream {
 public:
  TestStream(v1::IngestService::Stub& stub, const v1::OpenSession& open);
  ~TestStream();

  const v1::SessionOpened& opened() const { return opened_; }
  /// False: the stream is broken.
  bool Send(const v1::Scan& scan);
  bool Send(const v1::PoseBatch& poses);
  bool SendClose();
  bool SendEmpty();
  void HalfClose() { stream_->WritesDone(); }
  /// Vanishes without a word.
  void Vanish() { context_.TryCancel(); }

  /// Reads acknowledgements until scans up to `seq` are fused or refused.
  bool ReadUntilFused(std::uint64_t seq);
  /// Reads acknowledgements until there are so many problems.
  bool ReadUntilProblems(std::size_t num_problems);
  /// Reads on to the end of the session.
  bool ReadUntilClosed();
  /// Reads to the end of the stream.
  grpc::Status Finish();

  // What was read so far.
  std::uint64_t fused_seq() const { return fused_seq_; }
  std::uint64_t accepted_seq() const { return accepted_seq_; }
  std::uint64_t credit_bytes() const { return credit_bytes_; }  ///< given back, summed up
  const std::vector<v1::ScanProblem>& problems() const { return problems_; }
  std::uint64_t problems_left_out() const { return problems_left_out_; }
  const v1::SessionClosed& closed() const { return closed_; }
  bool has_closed() const { return has_closed_; }
  bool drained() const { return drained_; }

 private:
  bool ReadOne();
  bool ReadUntil(const std::function<bool()>& done);

  grpc::ClientContext context_;
  std::unique_ptr<grpc::ClientReaderWriter<v1::IngestRequest, v1::IngestResponse>> stream_;
  v1::SessionOpened opened_;
  v1::SessionClosed closed_;
  bool has_closed_ = false;
  bool drained_ = false;
  bool finished_ = false;
  std::uint64_t fused_seq_ = 0;
  std::uint64_t accepted_seq_ = 0;
  std::uint64_t credit_bytes_ = 0;
  std::uint64_t problems_left_out_ = 0;
  std::vector<v1::ScanProblem> problems_;
};

/// All tiles of a map in one version, decoded.
struct TestMap {
  MapVersion version;
  std::vector<wire::DecodedTile> tiles;
  /// Known cells of G with their heights.
  std::vector<std::pair<CellIndex, float>> Cells() const;
};
TestMap FetchMap(TestServer& server, const std::string& map);
wire::DecodedLocalMap FetchLocalMap(TestServer& server, const std::string& robot);

}  // namespace gem
