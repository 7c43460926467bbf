// TileService as planners at the far end of a link use it: pinned reads, etags, StreamTiles,
// WatchTiles that break off and resume, readers that do not read, WatchLocalMap.
#include <gmock/gmock.h>
#include <unistd.h>

#include <atomic>
#include <fstream>
#include <map>
#include <random>
#include <thread>

#include "google/rpc/error_details.pb.h"
#include "proto/wire/correction.h"
#include "proto/wire/region.h"
#include "tests/server/test_server.h"

namespace gem {
namespace {

using Address = std::pair<std::int32_t, std::int32_t>;

ServerOptions SmallTiles() {
  ServerOptions options = TestOptions();
  options.map.cell_size_m = 0.1f;  // tiles of 12.8 m
  return options;
}

/// Scans lie 0.5 m apart along x.
double PositionOf(std::uint64_t seq) { return 0.5 * static_cast<double>(seq); }

/// Shifts the whole trajectory of session "s1" across x, and waits until that is published.
v1::MapVersion Shift(TestServer& server, double y_m, std::uint64_t num_scans) {
  wire::CorrectionRequest request{"site", "s1", "", {}};
  for (std::uint64_t seq = 1; seq <= num_scans; ++seq)
    request.poses.push_back(
        {StampOf(seq), Pose<Global, Base>::FromTranslation(PositionOf(seq), y_m, 1)});
  v1::CorrectTrajectoryRequest proto;
  wire::ToProto(request, &proto);
  v1::CorrectTrajectoryResponse response;
  const grpc::Status status = TestServer::Call(
      server.ingest(), &v1::IngestService::Stub::CorrectTrajectory, proto, response);
  EXPECT_TRUE(status.ok()) << status.error_message();
  return response.version();
}

/// Drives along x from scan `first` on.
bool Drive(TestStream& robot, std::uint64_t first, std::uint64_t last) {
  for (std::uint64_t seq = first; seq <= last; ++seq)
    if (!robot.Send(FlatScan(seq, PositionOf(seq)))) return false;
  return robot.ReadUntilFused(last);
}

v1::OpenSession OpenWithShortSubmaps() {
  v1::OpenSession open = TestOpen("r1", "s1");
  open.mutable_map_setup()->set_submap_length_m(2);
  return open;
}

/// The 64 tiles around the road, whatever it is shifted by.
v1::BatchGetTilesRequest AllTiles() {
  v1::BatchGetTilesRequest request;
  request.set_map("site");
  request.set_encoding(v1::CELL_ENCODING_RAW);
  for (std::int32_t y = -3; y < 5; ++y)
    for (std::int32_t x = -1; x < 7; ++x) {
      request.add_tiles()->set_x(x);
      request.mutable_tiles(request.tiles_size() - 1)->set_y(y);
    }
  return request;
}
Region RegionOfAllTiles() {
  const double side_m = 128 * static_cast<double>(0.1f);
  return {-side_m, -3 * side_m, 7 * side_m, 5 * side_m};
}

/// Etags by address of a fresh read; absent tiles have none.
std::map<Address, std::uint64_t> ReadAll(TestServer& server, const v1::MapVersion* at,
                                         const std::vector<v1::Layer>& layers = {}) {
  v1::BatchGetTilesRequest request = AllTiles();
  for (const v1::Layer layer : layers) request.add_layers(layer);
  if (at != nullptr) *request.mutable_at() = *at;
  v1::BatchGetTilesResponse response;
  const grpc::Status status =
      TestServer::Call(server.tiles(), &v1::TileService::Stub::BatchGetTiles, request, response);
  EXPECT_TRUE(status.ok()) << status.error_message();
  EXPECT_TRUE(at == nullptr || response.version().revision() == at->revision());
  std::map<Address, std::uint64_t> etags;
  for (const v1::Tile& tile : response.tiles())
    if (!tile.absent()) etags[{tile.key().x(), tile.key().y()}] = tile.etag();
  return etags;
}

/// A planner's end of WatchTiles: gathers parts, applies them when they are complete.
class Planner {
 public:
  Planner(TestServer& server, const v1::WatchTilesRequest& request)
      : server_(server), request_(request) {}
  ~Planner() { Disconnect(); }

  void Connect() {
    context_ = std::make_unique<grpc::ClientContext>();
    context_->set_deadline(TestDeadline());
    if (version_.epoch() != 0) *request_.mutable_resume_from() = version_;
    stream_ = server_.tiles().WatchTiles(context_.get(), request_);
  }
  void Disconnect() {
    if (stream_ == nullptr) return;
    context_->TryCancel();
    v1::WatchTilesResponse ignored;
    while (stream_->Read(&ignored)) {
    }
    stream_->Finish();
    stream_ = nullptr;
    gathered_.clear();
  }
  /// The stream ends by itself.
  grpc::Status Finish() {
    v1::WatchTilesResponse part;
    while (stream_->Read(&part)) Take(part);
    const grpc::Status status = stream_->Finish();
    stream_ = nullptr;
    return status;
  }

  /// False: the stream has ended.
  bool ReadPart() {
    v1::WatchTilesResponse part;
    if (!stream_->Read(&part)) return false;
    Take(part);
    return true;
  }
  bool ReadUntil(const v1::MapVersion& version) {
    while (!complete_ || version_.revision() < version.revision())
      if (!ReadPart()) return false;
    return true;
  }

  bool complete() const { return complete_; }
  const v1::MapVersion& version() const { return version_; }
  const std::map<Address, std::uint64_t>& held() const { return held_; }
  int num_resets() const { return num_resets_; }
  std::uint64_t num_skipped() const { return num_skipped_; }
  std::size_t largest_part_bytes() const { return largest_part_bytes_; }

 private:
  void Take(const v1::WatchTilesResponse& part) {
    largest_part_bytes_ = std::max(largest_part_bytes_, part.ByteSizeLong());
    complete_ = false;
    EXPECT_FALSE(part.reset() && part.has_base());
    if (part.reset()) {
      ++num_resets_;
      held_.clear();
      gathered_.clear();
    } else if (part.has_base()) {
      EXPECT_EQ(part.base().revision(), version_.revision());
    }
    for (const v1::Tile& tile : part.tiles())
      gathered_[{tile.key().x(), tile.key().y()}] = tile.absent() ? 0 : tile.etag();
    if (!part.complete()) return;
    for (const auto& [address, etag] : gathered_) {
      if (etag == 0) {
        held_.erase(address);
      } else {
        held_[address] = etag;
      }
    }
    gathered_.clear();
    num_skipped_ += part.num_versions_skipped();
    version_ = part.version();
    complete_ = true;
  }

  TestServer& server_;
  v1::WatchTilesRequest request_;
  std::unique_ptr<grpc::ClientContext> context_;
  std::unique_ptr<grpc::ClientReader<v1::WatchTilesResponse>> stream_;
  v1::MapVersion version_;
  std::map<Address, std::uint64_t> held_;
  std::map<Address, std::uint64_t> gathered_;
  bool complete_ = false;
  int num_resets_ = 0;
  std::uint64_t num_skipped_ = 0;
  std::size_t largest_part_bytes_ = 0;
};

v1::WatchTilesRequest WatchAll() {
  v1::WatchTilesRequest request;
  request.set_map("site");
  wire::ToProto(RegionOfAllTiles(), request.mutable_region());
  request.set_encoding(v1::CELL_ENCODING_RAW);  // a part for each tile
  return request;
}

TEST(Watching, BeginsWithTheMapAndGoesOnWithChanges) {
  TestServer server(SmallTiles());
  TestStream robot(server.ingest(), OpenWithShortSubmaps());
  ASSERT_TRUE(Drive(robot, 1, 40));
  const v1::MapVersion first = Shift(server, 0, 40);
  Planner planner(server, WatchAll());
  planner.Connect();
  ASSERT_TRUE(planner.ReadUntil(first));
  EXPECT_EQ(planner.num_resets(), 1);
  EXPECT_GT(planner.held().size(), 2u);
  // The road goes elsewhere: tiles go, others come.
  const v1::MapVersion second = Shift(server, 40, 40);
  ASSERT_TRUE(planner.ReadUntil(second));
  EXPECT_EQ(planner.num_resets(), 1);
  EXPECT_EQ(planner.held(), ReadAll(server, &planner.version()));
  EXPECT_EQ(server.Metric("gem_rpc_active_calls{method=\"WatchTiles\"}"), 1);
  EXPECT_GE(server.Metric("gem_rpc_sent_messages_total{method=\"WatchTiles\"}"), 2);
  EXPECT_GE(server.Metric("gem_watch_lag_seconds"), 0);
  EXPECT_GT(server.Metric("gem_tile_cache_bytes"), 0);
}

// What a planner on a radio link lives through: the connection breaks all the time, while a robot
// drives and corrections throw the map about. At every complete version it holds exactly the tiles
// of that version.
TEST(Watching, SurvivesTwentyDisconnectionsExactly) {
  constexpr std::uint64_t kScans = 160;
  TestServer server(SmallTiles());
  TestStream robot(server.ingest(), OpenWithShortSubmaps());
  ASSERT_TRUE(Drive(robot, 1, 60));
  std::mt19937 random(7);
  Planner planner(server, WatchAll());
  planner.Connect();
  ASSERT_TRUE(planner.ReadUntil(Shift(server, 0, 60)));
  planner.Disconnect();
  int num_complete = 0, num_broken = 0;
  for (std::uint64_t seq = 60; seq < kScans; seq += 5) {
    ASSERT_TRUE(Drive(robot, seq + 1, seq + 5));
    Shift(server, seq % 2 == 0 ? 0 : 30, seq + 5);  // every tile goes elsewhere
    planner.Connect();
    // Now and then long enough for the whole change.
    auto parts_max = 1 + random() % 30;
    do {
      ASSERT_TRUE(planner.ReadPart());
    } while (!planner.complete() && --parts_max > 0);
    (planner.complete() ? num_complete : num_broken) += 1;
    EXPECT_TRUE(!planner.complete() || planner.held() == ReadAll(server, &planner.version()));
    planner.Disconnect();
  }
  EXPECT_GT(num_complete, 0);
  EXPECT_GT(num_broken, 0) << "some must break off in the middle of a change";
  ASSERT_TRUE(robot.SendClose());
  ASSERT_TRUE(robot.ReadUntilClosed());
  const v1::MapVersion last = Shift(server, 15, kScans);
  planner.Connect();
  ASSERT_TRUE(planner.ReadUntil(last));
  EXPECT_EQ(planner.held(), ReadAll(server, nullptr));
  EXPECT_GT(planner.held().size(), 4u);
  EXPECT_EQ(planner.num_resets(), 1) << "resuming must not begin anew";
}

#if defined(__has_feature)
#if __has_feature(address_sanitizer)
#define GEM_WATCHING_TEST_ASAN
#endif
#endif
#if defined(GEM_WATCHING_TEST_ASAN)
constexpr bool kAddressSanitizer = true;
#else
constexpr bool kAddressSanitizer = false;
#endif

std::size_t ResidentBytes() {
  std::size_t total = 0, resident = 0;
  std::ifstream("/proc/self/statm") >> total >> resident;
  return resident * static_cast<std::size_t>(sysconf(_SC_PAGESIZE));
}

// Readers that never read while the whole map changes a hundred times: they hold a part each, and
// nobody else waits for them. Kept snapshots would be 100 times 5 MB.
TEST(Watching, ReadersThatDoNotReadCostNoMemoryAndDelayNobody) {
  ServerOptions options = SmallTiles();
  options.revision_bytes_max = 32u << 20;
  options.tile_cache_bytes_max = 4u << 20;
  TestServer server(options);
  TestStream robot(server.ingest(), OpenWithShortSubmaps());
  ASSERT_TRUE(Drive(robot, 1, 60));
  ASSERT_TRUE(robot.SendClose());
  ASSERT_TRUE(robot.ReadUntilClosed());

  v1::WatchTilesRequest raw = WatchAll();
  const std::vector<v1::Layer> layers = {v1::LAYER_ELEVATION, v1::LAYER_VARIANCE, v1::LAYER_AGE};
  for (const v1::Layer layer : layers) raw.add_layers(layer);
  std::vector<std::unique_ptr<Planner>> asleep;
  for (int i = 0; i < 20; ++i) {
    asleep.push_back(std::make_unique<Planner>(server, raw));
    asleep.back()->Connect();
  }
  Planner awake(server, raw);
  awake.Connect();
  for (int i = 0; i < 30; ++i) Shift(server, i % 2 == 0 ? 0.5 : 0, 60);
  const std::size_t before = ResidentBytes();
  v1::MapVersion last;
  for (int i = 0; i < 100; ++i) {
    last = Shift(server, i % 2 == 0 ? 0.5 : 0, 60);
    ASSERT_TRUE(awake.ReadUntil(last));
  }
  const std::size_t after = ResidentBytes();
  // Kept snapshots would be 500 MB. AddressSanitizer itself keeps what was freed.
  if (!kAddressSanitizer) {
    EXPECT_LT(after, before + (128u << 20));
  }
  EXPECT_LE(server.Metric("gem_replaced_revision_bytes{map=\"site\"}"), 48 << 20);
  EXPECT_LE(server.Metric("gem_tile_cache_bytes"), 4 << 20);
  EXPECT_EQ(awake.held(), ReadAll(server, nullptr, layers));
  // One that wakes up gets the newest, not a hundred old ones.
  ASSERT_TRUE(asleep.front()->ReadUntil(last));
  EXPECT_EQ(asleep.front()->held(), awake.held());
  EXPECT_GT(asleep.front()->num_skipped(), 50u);
}

TEST(Watching, KeysComeWithoutCells) {
  TestServer server(SmallTiles());
  TestStream robot(server.ingest(), OpenWithShortSubmaps());
  ASSERT_TRUE(Drive(robot, 1, 40));
  const v1::MapVersion version = Shift(server, 0, 40);
  v1::WatchTilesRequest request = WatchAll();
  request.set_keys_only(true);
  Planner planner(server, request);
  planner.Connect();
  ASSERT_TRUE(planner.ReadUntil(version));
  EXPECT_EQ(planner.held(), ReadAll(server, &planner.version()));
  EXPECT_LT(planner.largest_part_bytes(), planner.held().size() * 60 + 60);
}

TEST(Watching, HasALimitOfStreamsThatItNames) {
  ServerOptions options = SmallTiles();
  options.readers_max = 1;
  TestServer server(options);
  TestStream robot(server.ingest(), OpenWithShortSubmaps());
  Planner first(server, WatchAll());
  first.Connect();
  ASSERT_TRUE(first.ReadPart());
  Planner second(server, WatchAll());
  second.Connect();
  const grpc::Status status = second.Finish();
  EXPECT_EQ(status.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_EQ(status.error_message(), "1 streams read maps, want at most 1");
}

TEST(Watching, EndsWithTheServerAndWithTheMap) {
  TestServer server(SmallTiles());
  TestStream robot(server.ingest(), OpenWithShortSubmaps());
  ASSERT_TRUE(Drive(robot, 1, 5));
  Planner planner(server, WatchAll());
  planner.Connect();
  ASSERT_TRUE(planner.ReadPart());
  v1::DeleteMapRequest request;
  request.set_map("site");
  request.set_force(true);
  v1::DeleteMapResponse response;
  ASSERT_TRUE(
      TestServer::Call(server.maps(), &v1::MapService::Stub::DeleteMap, request, response).ok());
  EXPECT_EQ(planner.Finish().error_code(), grpc::StatusCode::NOT_FOUND);

  v1::OpenSession open = OpenWithShortSubmaps();
  open.set_session("s2");
  TestStream next(server.ingest(), open);
  // Another epoch under the same name: the planner begins anew.
  planner.Connect();
  ASSERT_TRUE(planner.ReadPart());
  EXPECT_EQ(planner.num_resets(), 2);
  server.server().Stop();
  EXPECT_EQ(planner.Finish().error_code(), grpc::StatusCode::UNAVAILABLE);
}

TEST(PinnedReads, StayConsistentAcrossACorrectionAndThenExpire) {
  ServerOptions options = SmallTiles();
  options.revision_retention_s = 3600;
  options.revision_bytes_max = 64u << 20;
  TestServer server(options);
  TestStream robot(server.ingest(), OpenWithShortSubmaps());
  ASSERT_TRUE(Drive(robot, 1, 60));
  ASSERT_TRUE(robot.SendClose());
  ASSERT_TRUE(robot.ReadUntilClosed());
  const v1::MapVersion pinned = Shift(server, 0, 60);
  const auto before = ReadAll(server, &pinned);
  Shift(server, 30, 60);
  EXPECT_NE(ReadAll(server, nullptr), before);
  EXPECT_EQ(ReadAll(server, &pinned), before);
  for (int i = 0; i < 20; ++i) Shift(server, i % 2 == 0 ? 0 : 30, 60);

  v1::BatchGetTilesRequest request = AllTiles();
  *request.mutable_at() = pinned;
  v1::BatchGetTilesResponse response;
  grpc::Status status =
      TestServer::Call(server.tiles(), &v1::TileService::Stub::BatchGetTiles, request, response);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::FAILED_PRECONDITION);
  google::rpc::Status details;
  ASSERT_TRUE(details.ParseFromString(status.error_details()));
  bool has_reason = false;
  for (const auto& detail : details.details()) {
    google::rpc::ErrorInfo info;
    if (detail.UnpackTo(&info)) has_reason = info.reason() == "REVISION_EXPIRED";
  }
  EXPECT_TRUE(has_reason);
  EXPECT_EQ(server.Metric("gem_expired_reads_total{map=\"site\"}"), 1);
  request.mutable_at()->set_revision(1'000'000);
  status =
      TestServer::Call(server.tiles(), &v1::TileService::Stub::BatchGetTiles, request, response);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
}

TEST(Etags, SpareTilesThatTheClientHolds) {
  TestServer server(SmallTiles());
  TestStream robot(server.ingest(), OpenWithShortSubmaps());
  ASSERT_TRUE(Drive(robot, 1, 40));
  ASSERT_TRUE(robot.SendClose());
  ASSERT_TRUE(robot.ReadUntilClosed());
  v1::BatchGetTilesRequest request = AllTiles();
  v1::BatchGetTilesResponse first;
  ASSERT_TRUE(
      TestServer::Call(server.tiles(), &v1::TileService::Stub::BatchGetTiles, request, first).ok());
  for (const v1::Tile& tile : first.tiles()) request.add_if_none_match(tile.etag());
  // One of them is out of date.
  int changed = 0;
  while (!first.tiles(changed).has_grid()) ++changed;
  request.set_if_none_match(changed, 1);
  v1::BatchGetTilesResponse second;
  ASSERT_TRUE(
      TestServer::Call(server.tiles(), &v1::TileService::Stub::BatchGetTiles, request, second)
          .ok());
  for (int i = 0; i < first.tiles_size(); ++i) {
    EXPECT_EQ(second.tiles(i).has_grid(), i == changed) << i;
    EXPECT_EQ(second.tiles(i).not_modified(), first.tiles(i).has_grid() && i != changed) << i;
    EXPECT_EQ(second.tiles(i).etag(), first.tiles(i).etag()) << i;
    EXPECT_EQ(second.tiles(i).absent(), first.tiles(i).absent()) << i;
  }
  EXPECT_GE(server.Metric("gem_tiles_served_total{outcome=\"not_modified\"}"), 1);
  EXPECT_GE(server.Metric("gem_tile_cache_requests_total{result=\"hit\"}"), 1);
}

TEST(Pyramid, CoarserLevelsAreListedAndServed) {
  TestServer server(SmallTiles());
  TestStream robot(server.ingest(), OpenWithShortSubmaps());
  ASSERT_TRUE(Drive(robot, 1, 60));
  ASSERT_TRUE(robot.SendClose());
  ASSERT_TRUE(robot.ReadUntilClosed());
  v1::GetTileMatrixRequest request;
  request.set_map("site");
  request.set_level(2);
  v1::GetTileMatrixResponse matrix;
  ASSERT_TRUE(
      TestServer::Call(server.tiles(), &v1::TileService::Stub::GetTileMatrix, request, matrix)
          .ok());
  EXPECT_EQ(matrix.max_level(), 6u);
  ASSERT_GT(matrix.tiles_size(), 0);
  v1::BatchGetTilesRequest batch;
  batch.set_map("site");
  *batch.mutable_tiles() = matrix.tiles();
  v1::BatchGetTilesResponse tiles;
  ASSERT_TRUE(
      TestServer::Call(server.tiles(), &v1::TileService::Stub::BatchGetTiles, batch, tiles).ok());
  for (const v1::Tile& tile : tiles.tiles()) {
    EXPECT_EQ(tile.key().level(), 2u);
    EXPECT_NEAR(tile.grid().cell_size_m(), 0.4, 1e-6);
  }
}

/// All messages of a StreamTiles call.
grpc::Status Stream(TestServer& server, const v1::StreamTilesRequest& request,
                    std::vector<v1::StreamTilesResponse>& parts) {
  grpc::ClientContext context;
  context.set_deadline(TestDeadline());
  const auto stream = server.tiles().StreamTiles(&context, request);
  v1::StreamTilesResponse part;
  while (stream->Read(&part)) parts.push_back(part);
  return stream->Finish();
}

TEST(Streaming, SendsARegionNearestFirstInSmallMessages) {
  TestServer server(SmallTiles());
  TestStream robot(server.ingest(), OpenWithShortSubmaps());
  ASSERT_TRUE(Drive(robot, 1, 100));
  ASSERT_TRUE(robot.SendClose());
  ASSERT_TRUE(robot.ReadUntilClosed());
  v1::StreamTilesRequest request;
  request.set_map("site");
  request.set_encoding(v1::CELL_ENCODING_RAW);
  request.mutable_nearest_to()->set_x(45);
  std::vector<v1::StreamTilesResponse> parts;
  const grpc::Status status = Stream(server, request, parts);
  ASSERT_TRUE(status.ok()) << status.error_message();
  ASSERT_GT(parts.size(), 2u);
  std::map<Address, std::uint64_t> etags;
  double nearest_m = 0;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    EXPECT_LT(parts[i].ByteSizeLong(), 1u << 20);
    EXPECT_EQ(parts[i].reset(), i == 0);
    EXPECT_EQ(parts[i].complete(), i + 1 == parts.size());
    EXPECT_EQ(parts[i].version().revision(), parts[0].version().revision());
    for (const v1::Tile& tile : parts[i].tiles()) {
      const double distance_m =
          std::hypot((tile.key().x() + 0.5) * 12.8 - 45, (tile.key().y() + 0.5) * 12.8);
      EXPECT_GE(distance_m, nearest_m - 1e-3);
      nearest_m = distance_m;
      EXPECT_TRUE(etags.emplace(Address(tile.key().x(), tile.key().y()), tile.etag()).second);
    }
  }
  v1::GetTileMatrixRequest matrix_request;
  matrix_request.set_map("site");
  v1::GetTileMatrixResponse matrix;
  ASSERT_TRUE(TestServer::Call(server.tiles(), &v1::TileService::Stub::GetTileMatrix,
                               matrix_request, matrix)
                  .ok());
  EXPECT_EQ(etags.size(), static_cast<std::size_t>(matrix.tiles_size()));

  // Nothing has changed since.
  *request.mutable_changed_after() = parts[0].version();
  std::vector<v1::StreamTilesResponse> nothing;
  ASSERT_TRUE(Stream(server, request, nothing).ok());
  ASSERT_EQ(nothing.size(), 1u);
  EXPECT_FALSE(nothing[0].reset());
  EXPECT_TRUE(nothing[0].complete());
  EXPECT_EQ(nothing[0].tiles_size(), 0);
}

TEST(Streaming, RefusesByName) {
  TestServer server(SmallTiles());
  v1::StreamTilesRequest request;
  request.set_map("site");
  std::vector<v1::StreamTilesResponse> parts;
  EXPECT_EQ(Stream(server, request, parts).error_code(), grpc::StatusCode::NOT_FOUND);
  request.mutable_region();
  const grpc::Status status = Stream(server, request, parts);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(status.error_message(), "region.x_max is 0, want more than 0");
}

TEST(WatchingLocalMaps, GoesOnWithTheNextSessionAndCountsWhatItSkipped) {
  TestServer server(SmallTiles());
  auto robot = std::make_unique<TestStream>(server.ingest(), OpenWithShortSubmaps());
  grpc::ClientContext context;
  context.set_deadline(TestDeadline());
  v1::WatchLocalMapRequest request;
  request.set_robot("r1");
  const auto stream = server.tiles().WatchLocalMap(&context, request);
  v1::WatchLocalMapResponse response;
  std::uint64_t num_seen = 0, num_skipped = 0;
  ASSERT_TRUE(Drive(*robot, 1, 1));
  do {
    ASSERT_TRUE(stream->Read(&response));
    ++num_seen;
    num_skipped += response.num_skipped();
    const std::uint64_t next = response.local_map().seq() + 1;
    ASSERT_TRUE(next > 30 || Drive(*robot, next, next));
  } while (response.local_map().seq() < 30);
  EXPECT_EQ(num_seen + num_skipped, 30u);
  ASSERT_TRUE(robot->SendClose());
  ASSERT_TRUE(robot->ReadUntilClosed());

  v1::OpenSession open = OpenWithShortSubmaps();
  open.set_session("s2");
  robot = std::make_unique<TestStream>(server.ingest(), open);
  ASSERT_TRUE(Drive(*robot, 1, 1));
  ASSERT_TRUE(stream->Read(&response));
  EXPECT_EQ(response.local_map().session(), "s2");
  EXPECT_EQ(response.local_map().seq(), 1u);
  EXPECT_TRUE(wire::FromProto(response.local_map(), wire::FieldPath("local_map")).ok());
  context.TryCancel();
  stream->Finish();
}

TEST(WatchingLocalMaps, UnknownRobotsAreNamed) {
  TestServer server(SmallTiles());
  grpc::ClientContext context;
  context.set_deadline(TestDeadline());
  v1::WatchLocalMapRequest request;
  request.set_robot("nobody");
  const auto stream = server.tiles().WatchLocalMap(&context, request);
  v1::WatchLocalMapResponse response;
  EXPECT_FALSE(stream->Read(&response));
  const grpc::Status status = stream->Finish();
  EXPECT_EQ(status.error_code(), grpc::StatusCode::NOT_FOUND);
  EXPECT_EQ(status.error_message(), "robot is nobody, want a robot that had a session");
}

}  // namespace
}  // namespace gem
