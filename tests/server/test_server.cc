#include "tests/server/test_server.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cmath>
#include <cstdlib>

namespace gem {

std::string FetchMetrics(const std::string& address) {
  const std::size_t colon = address.rfind(':');
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(static_cast<std::uint16_t>(std::atoi(address.c_str() + colon + 1)));
  inet_pton(AF_INET, address.substr(0, colon).c_str(), &to.sin_addr);
  const int socket = ::socket(AF_INET, SOCK_STREAM, 0);
  std::string page;
  if (::connect(socket, reinterpret_cast<sockaddr*>(&to), sizeof(to)) == 0) {
    const std::string request = "GET /metrics HTTP/1.0\r\n\r\n";
    if (::send(socket, request.data(), request.size(), 0) > 0) {
      char buffer[4096];
      for (ssize_t n = 0; (n = ::recv(socket, buffer, sizeof(buffer), 0)) > 0;)
        page.append(buffer, static_cast<std::size_t>(n));
    }
  }
  ::close(socket);
  return page;
}

double MetricValue(const std::string& page, const std::string& series) {
  const std::size_t line = page.find("\n" + series + " ");
  if (line == std::string::npos) return -1;
  return std::strtod(page.c_str() + line + series.size() + 2, nullptr);
}

TestServer::TestServer(const ServerOptions& options) {
  absl::StatusOr<std::unique_ptr<Server>> server = Server::Start(options);
  EXPECT_TRUE(server.ok()) << server.status();
  server_ = *std::move(server);
  const auto channel = NewChannel();
  ingest_ = v1::IngestService::NewStub(channel);
  tiles_ = v1::TileService::NewStub(channel);
  maps_ = v1::MapService::NewStub(channel);
  terrain_ = v1::TerrainService::NewStub(channel);
}

std::shared_ptr<grpc::Channel> TestServer::NewChannel() const {
  grpc::ChannelArguments arguments;
  arguments.SetMaxReceiveMessageSize(256 << 20);
  arguments.SetMaxSendMessageSize(256 << 20);
  arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
  return grpc::CreateCustomChannel(address(), grpc::InsecureChannelCredentials(), arguments);
}

v1::OpenSession TestOpen(const std::string& robot, const std::string& session) {
  v1::OpenSession open;
  open.set_map("site");
  open.set_robot(robot);
  open.set_session(session);
  v1::SensorSetup* sensor = open.add_sensors();
  sensor->set_name("top");
  sensor->mutable_base_from_sensor()->set_qw(1);
  return open;
}

v1::Scan FlatScan(std::uint64_t seq, double x_m, double y_m) {
  v1::Scan scan;
  scan.set_seq(seq);
  scan.set_stamp_ns(StampOf(seq));
  scan.set_sensor("top");
  scan.mutable_odom_from_base()->set_x(x_m);
  scan.mutable_odom_from_base()->set_y(y_m);
  scan.mutable_odom_from_base()->set_z(1);
  scan.mutable_odom_from_base()->set_qw(1);
  std::vector<ScanPoint> points;
  for (int row = -16; row < 16; ++row)
    for (int column = -16; column < 16; ++column)
      points.push_back({0.25f * static_cast<float>(column) + 0.125f,
                        0.25f * static_cast<float>(row) + 0.125f, -1, 0});
  wire::PointsToProto(points, &scan);
  return scan;
}

v1::PoseBatch PosesAt(const std::vector<double>& stamps_s, double speed_m_per_s) {
  v1::PoseBatch poses;
  for (const double stamp_s : stamps_s) {
    v1::OdometryPose* pose = poses.add_poses();
    pose->set_stamp_ns(std::llround(stamp_s * 1e9));
    pose->mutable_odom_from_base()->set_x(speed_m_per_s * stamp_s);
    pose->mutable_odom_from_base()->set_z(1);
    pose->mutable_odom_from_base()->set_qw(1);
  }
  return poses;
}

TestStream::TestStream(v1::IngestService::Stub& stub, const v1::OpenSession& open) {
  context_.set_deadline(TestDeadline());
  stream_ = stub.Ingest(&context_);
  v1::IngestRequest request;
  *request.mutable_open() = open;
  stream_->Write(request);
  ReadOne();
}

TestStream::~TestStream() {
  if (finished_) return;
  context_.TryCancel();
  stream_->Finish();
}

bool TestStream::Send(const v1::Scan& scan) {
  v1::IngestRequest request;
  *request.mutable_scan() = scan;
  return stream_->Write(request);
}

bool TestStream::Send(const v1::PoseBatch& poses) {
  v1::IngestRequest request;
  *request.mutable_poses() = poses;
  return stream_->Write(request);
}

bool TestStream::SendClose() {
  v1::IngestRequest request;
  request.mutable_close();
  return stream_->Write(request);
}

bool TestStream::SendEmpty() { return stream_->Write(v1::IngestRequest()); }

bool TestStream::ReadOne() {
  v1::IngestResponse response;
  if (!stream_->Read(&response)) return false;
  if (response.has_opened()) opened_ = response.opened();
  if (response.has_ack()) {
    accepted_seq_ = response.ack().accepted_seq();
    fused_seq_ = response.ack().fused_seq();
    credit_bytes_ += response.ack().credit_bytes();
    problems_left_out_ += response.ack().problems_left_out();
    problems_.insert(problems_.end(), response.ack().problems().begin(),
                     response.ack().problems().end());
  }
  drained_ = drained_ || response.has_drain();
  if (response.has_closed()) {
    closed_ = response.closed();
    has_closed_ = true;
  }
  return true;
}

bool TestStream::ReadUntil(const std::function<bool()>& done) {
  while (!done())
    if (!ReadOne()) return false;
  return true;
}

bool TestStream::ReadUntilFused(std::uint64_t seq) {
  return ReadUntil([&] { return fused_seq_ >= seq; });
}

bool TestStream::ReadUntilProblems(std::size_t num_problems) {
  return ReadUntil([&] { return problems_.size() >= num_problems; });
}

bool TestStream::ReadUntilClosed() {
  return ReadUntil([&] { return has_closed_; });
}

grpc::Status TestStream::Finish() {
  while (ReadOne()) {
  }
  finished_ = true;
  return stream_->Finish();
}

std::vector<std::pair<CellIndex, float>> TestMap::Cells() const {
  std::vector<std::pair<CellIndex, float>> cells;
  for (const wire::DecodedTile& tile : tiles) {
    if (!tile.grid.has_value()) continue;
    const GridLayer& heights = *tile.grid->Find(Layer::kElevation);
    const CellIndex origin = OriginOf(tile.address.index);
    for (std::int32_t i = 0; i < kTileCells * kTileCells; ++i)
      if (heights.valid[static_cast<std::size_t>(i)])
        cells.push_back({{origin.x + i % kTileCells, origin.y + i / kTileCells},
                         heights.values[static_cast<std::size_t>(i)]});
  }
  return cells;
}

TestMap FetchMap(TestServer& server, const std::string& map) {
  v1::GetTileMatrixRequest matrix_request;
  matrix_request.set_map(map);
  v1::GetTileMatrixResponse matrix;
  TestMap result;
  grpc::Status status = TestServer::Call(server.tiles(), &v1::TileService::Stub::GetTileMatrix,
                                         matrix_request, matrix);
  EXPECT_TRUE(status.ok()) << status.error_message();
  result.version = wire::FromProto(matrix.version());
  if (matrix.tiles().empty()) return result;
  v1::BatchGetTilesRequest request;
  request.set_map(map);
  request.set_encoding(v1::CELL_ENCODING_RAW);
  *request.mutable_tiles() = matrix.tiles();
  v1::BatchGetTilesResponse response;
  status =
      TestServer::Call(server.tiles(), &v1::TileService::Stub::BatchGetTiles, request, response);
  EXPECT_TRUE(status.ok()) << status.error_message();
  result.version = wire::FromProto(response.version());
  for (const v1::Tile& proto : response.tiles()) {
    const absl::StatusOr<wire::DecodedTile> tile = wire::FromProto(proto, wire::FieldPath("tile"));
    EXPECT_TRUE(tile.ok()) << tile.status();
    if (tile.ok()) result.tiles.push_back(*tile);
  }
  return result;
}

wire::DecodedLocalMap FetchLocalMap(TestServer& server, const std::string& robot) {
  v1::GetLocalMapRequest request;
  request.set_robot(robot);
  v1::GetLocalMapResponse response;
  const grpc::Status status =
      TestServer::Call(server.tiles(), &v1::TileService::Stub::GetLocalMap, request, response);
  EXPECT_TRUE(status.ok()) << status.error_message();
  const auto map = wire::FromProto(response.local_map(), wire::FieldPath("local_map"));
  EXPECT_TRUE(map.ok()) << map.status();
  return map.value_or(wire::DecodedLocalMap());
}

}  // namespace gem
