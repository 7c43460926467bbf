#include "tests/fuzz/client_answers.h"

#include <google/protobuf/stubs/logging.h>
#include <grpcpp/generic/async_generic_service.h>
#include <grpcpp/grpcpp.h>

#include <array>
#include <cmath>
#include <memory>
#include <utility>

#include "absl/strings/str_cat.h"
#include "client/ingest_client.h"
#include "client/map_client.h"
#include "core/base/check.h"
#include "core/base/mutex.h"
#include "gem/v1/ingest_service.pb.h"
#include "gem/v1/map_service.pb.h"
#include "gem/v1/tile_service.pb.h"
#include "proto/wire/map.h"
#include "tests/fuzz/framed_messages.h"

namespace gem::fuzz {
namespace {

using client::MapClient;

constexpr double kPatience_s = 30;

/// Answers any call with the bytes that are next, and is away when there are none.
class ScriptedService final : public grpc::CallbackGenericService {
 public:
  void Script(std::vector<std::string> answers) {
    MutexLock lock(mutex_);
    answers_ = std::move(answers);
    next_ = 0;
  }

 private:
  class Reactor final : public grpc::ServerGenericBidiReactor {
   public:
    Reactor(ScriptedService& service, bool is_stream) : service_(service), is_stream_(is_stream) {
      StartRead(&request_);
    }
    void OnReadDone(bool ok) override {
      if (!ok) return Finish(grpc::Status::CANCELLED);
      // A stream's first message is enough to tell all that there is to tell.
      WriteNext();
    }
    void OnWriteDone(bool ok) override {
      if (is_stream_ && ok) return WriteNext();
      Finish(grpc::Status::OK);
    }
    void OnDone() override { delete this; }

   private:
    void WriteNext() {
      std::string answer;
      if (!service_.Next(answer))
        return Finish(grpc::Status(grpc::StatusCode::NOT_FOUND, "the script is over"));
      const grpc::Slice slice(answer);
      response_ = grpc::ByteBuffer(&slice, 1);
      StartWrite(&response_);
    }

    ScriptedService& service_;
    const bool is_stream_;
    grpc::ByteBuffer request_;
    grpc::ByteBuffer response_;
  };

  grpc::ServerGenericBidiReactor* CreateReactor(
      grpc::GenericCallbackServerContext* context) override {
    return new Reactor(*this, context->method().find("/Ingest") != std::string::npos);
  }

  bool Next(std::string& answer) {
    MutexLock lock(mutex_);
    if (next_ == answers_.size()) return false;
    answer = answers_[next_++];
    return true;
  }

  Mutex mutex_;
  std::vector<std::string> answers_ ABSL_GUARDED_BY(mutex_);
  std::size_t next_ ABSL_GUARDED_BY(mutex_) = 0;
};

class ScriptedServer {
 public:
  ScriptedServer() {
    grpc::ServerBuilder builder;
    int port = 0;
    builder.AddListeningPort("127.0.0.1:0", grpc::InsecureServerCredentials(), &port);
    builder.RegisterCallbackGenericService(&service_);
    server_ = builder.BuildAndStart();
    GEM_CHECK(server_ != nullptr && port != 0);
    client::ConnectionOptions options;
    options.address = absl::StrCat("127.0.0.1:", port);
    connection_ = std::make_shared<const client::Connection>(options);
  }
  void Script(std::vector<std::string> answers) { service_.Script(std::move(answers)); }
  const std::shared_ptr<const client::Connection>& connection() const { return connection_; }

 private:
  ScriptedService service_;
  std::unique_ptr<grpc::Server> server_;
  std::shared_ptr<const client::Connection> connection_;
};

void CheckGrid(const LayeredGrid& grid) {
  for (const GridLayer& layer : grid.layers) {
    GEM_CHECK(layer.valid.size() == grid.num_cells());
    for (const float value : layer.values) GEM_CHECK(std::isfinite(value));
  }
}

void GetTiles(const MapClient& client) {
  const auto set = client.GetTiles(
      "site", {{0, 0}, {-1, 2}}, {{Layer::kElevation, Layer::kColor}, client::CellEncoding::kRaw});
  if (!set.ok()) return;
  GEM_CHECK(set->tiles.size() == 2);
  for (const client::MapTile& tile : set->tiles)
    if (tile.grid) CheckGrid(*tile.grid);
}

void GetLocalMap(const MapClient& client) {
  const auto map = client.GetLocalMap("robot", {});
  if (map.ok()) CheckGrid(map->grid);
}

void OpenSession(const ScriptedServer& server) {
  client::SessionSetup setup;
  setup.map = setup.robot = setup.session = "a";
  setup.sensors = {{"top", {}, *MakeNoiseModel(LidarNoise())}};
  client::IngestOptions options;
  options.open_timeout_s = options.progress_timeout_s = kPatience_s;
  options.tries_max = 1;
  options.backoff_s_min = options.backoff_s_max = 0;
  options.on_problem = [](const client::IngestProblem& problem) {
    GEM_CHECK(!problem.reason.empty());
  };
  auto ingest = client::IngestClient::Open(server.connection(), setup, options);
  if (!ingest.ok()) return;
  const std::vector<ScanPoint> points = {{1, 2, 3, 0}};
  if (!(*ingest)->Send({1, "top", Pose<Odom, Base>(), std::nullopt, points}).ok()) return;
  (void)(*ingest)->Close();
}

using Call = void (*)(const ScriptedServer&, const MapClient&);
constexpr std::array<Call, 8> kCalls = {
    [](const ScriptedServer&, const MapClient& client) { GetTiles(client); },
    [](const ScriptedServer&, const MapClient& client) { GetLocalMap(client); },
    [](const ScriptedServer&, const MapClient& client) { (void)client.GetTileMatrix("site"); },
    [](const ScriptedServer&, const MapClient& client) { (void)client.GetMap("site"); },
    [](const ScriptedServer&, const MapClient& client) { (void)client.ListMaps(); },
    [](const ScriptedServer&, const MapClient& client) { (void)client.ListSubmaps("site"); },
    [](const ScriptedServer&, const MapClient& client) { (void)client.GetServerStatus(); },
    [](const ScriptedServer& server, const MapClient&) { OpenSession(server); },
};

std::string Seed(char call, const std::vector<std::string>& answers) {
  return std::string(1, call) + Frame(answers);
}

/// The bitmap and the heights of a tile with one known cell are small when they are compressed, and
/// raw they are not: fuzzers want them small.
v1::BatchGetTilesResponse TwoTiles() {
  v1::BatchGetTilesResponse response;
  gem::Tile tile{0, {0, 0}, {3, 4}, std::vector<CellBelief>(kTileCells * kTileCells)};
  tile.cells[5] = {1.5f,       0.01f,         0.9f,
                   0xff102030, 1'000'000'000, kCellKnown | kCellAnnotated | kCellColored};
  constexpr std::array kLayers = {Layer::kElevation, Layer::kColor};
  wire::ToProto(tile, 0.2f, kLayers, wire::CellEncoding::kCompact, response.add_tiles());
  wire::ToProto(TileAddress{0, {-1, 2}}, response.add_tiles()->mutable_key());
  response.mutable_tiles(1)->set_absent(true);
  response.mutable_version()->set_epoch(3);
  return response;
}

std::vector<std::string> IngestAnswers() {
  v1::IngestResponse opened, ack, closed;
  opened.mutable_opened()->set_credit_bytes(1000);
  opened.mutable_opened()->set_scan_bytes_max(1000);
  ack.mutable_ack()->set_accepted_seq(1);
  ack.mutable_ack()->set_fused_seq(1);
  ack.mutable_ack()->add_problems()->set_message("why");
  closed.mutable_closed()->set_num_scans_fused(1);
  return {opened.SerializeAsString(), ack.SerializeAsString(), closed.SerializeAsString()};
}

}  // namespace

void ClientAnswer(const std::uint8_t* data, std::size_t size) {
  google::protobuf::SetLogHandler(nullptr);
  if (size == 0) return;
  static auto* server = new ScriptedServer;
  static auto* client = new MapClient(server->connection(), {kPatience_s, kPatience_s, 2, 1});
  std::vector<std::string> answers;
  for (const std::string_view message :
       FramedMessages({reinterpret_cast<const char*>(data) + 1, size - 1}))
    answers.emplace_back(message);
  server->Script(std::move(answers));
  kCalls[data[0] % kCalls.size()](*server, *client);
}

std::vector<std::string> ClientAnswerSeeds() {
  v1::GetTileMatrixResponse matrix;
  matrix.set_cell_size_m(0.2);
  matrix.set_tile_cells(kTileCells);
  matrix.add_tiles()->set_x(-1);
  v1::ListMapsResponse maps;
  maps.add_maps()->set_id("site");
  maps.set_next_page_token("site");
  v1::ListSubmapsResponse submaps;
  submaps.add_submaps()->mutable_map_from_submap()->set_qw(1);
  v1::GetServerStatusResponse status;
  status.add_sessions()->set_robot("robot");
  status.add_timings()->add_buckets()->set_count(1);
  v1::GetLocalMapResponse local;
  local.mutable_local_map()->set_session("s");
  return {Seed(0, {TwoTiles().SerializeAsString()}),
          Seed(1, {local.SerializeAsString()}),
          Seed(2, {matrix.SerializeAsString()}),
          Seed(3, {std::string()}),
          Seed(4, {maps.SerializeAsString(), std::string()}),
          Seed(5, {submaps.SerializeAsString()}),
          Seed(6, {status.SerializeAsString()}),
          Seed(7, IngestAnswers())};
}

}  // namespace gem::fuzz
