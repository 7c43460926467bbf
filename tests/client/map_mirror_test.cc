// MapMirror and LocalMapSubscriber against a scripted server: what they ask for when a stream has
// broken, and what they show meanwhile.
#include "client/map_mirror.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <utility>
#include <vector>

#include "absl/synchronization/mutex.h"
#include "absl/synchronization/notification.h"
#include "client/local_map_subscriber.h"
#include "proto/wire/grid.h"
#include "proto/wire/pose.h"
#include "tests/client/fake_server.h"

namespace gem::client {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr double kLong_s = 60;

using TileWriter = grpc::ServerWriter<v1::WatchTilesResponse>;

LayeredGrid FlatGrid(std::int32_t side, float value) {
  LayeredGrid grid{side, side, 0.5, {}};
  for (const Layer layer : {Layer::kElevation, Layer::kTraversability})
    grid.layers.push_back({layer,
                           std::vector<std::uint8_t>(grid.num_cells(), 1),
                           std::vector<float>(grid.num_cells(), value),
                           {}});
  return grid;
}

void AddTile(std::int32_t x, float value, v1::WatchTilesResponse& response) {
  v1::Tile& tile = *response.add_tiles();
  tile.mutable_key()->set_x(x);
  wire::ToProto(FlatGrid(kTileCells, value), wire::CellEncoding::kRaw, tile.mutable_grid());
}

v1::WatchTilesResponse Part(std::uint64_t epoch, std::uint64_t revision, bool complete) {
  v1::WatchTilesResponse response;
  response.mutable_version()->set_epoch(epoch);
  response.mutable_version()->set_revision(revision);
  response.set_complete(complete);
  return response;
}
v1::WatchTilesResponse Snapshot(std::uint64_t epoch, std::uint64_t revision, float value) {
  v1::WatchTilesResponse response = Part(epoch, revision, true);
  response.set_reset(true);
  AddTile(0, value, response);
  return response;
}
v1::WatchTilesResponse Change(std::uint64_t epoch, std::uint64_t from, std::uint64_t to,
                              float value, bool complete = true) {
  v1::WatchTilesResponse response = Part(epoch, to, complete);
  response.mutable_base()->set_epoch(epoch);
  response.mutable_base()->set_revision(from);
  AddTile(0, value, response);
  return response;
}

class MirrorTest : public ::testing::Test {
 protected:
  MirrorTest() {
    server_.tile.on_matrix = [this](const auto&, auto& response) {
      response.set_cell_size_m(0.5);
      response.set_tile_cells(128);
      response.set_traversability_free(0.7f);
      response.set_max_level(6);
      response.mutable_version()->set_epoch(epoch_);
      return grpc::Status::OK;
    };
  }
  ~MirrorTest() override {
    if (!let_go_.HasBeenNotified()) let_go_.Notify();
    server_.Stop();
  }

  static MirrorOptions Options() {
    MirrorOptions options;
    options.map = "yard";
    options.retry = {1e-3, 1e-3};
    return options;
  }
  /// Keeps a stream open to the end of the test; the client may leave it.
  grpc::Status Stay() {
    let_go_.WaitForNotification();
    return grpc::Status::OK;
  }
  void Note(const v1::WatchTilesRequest& request) {
    absl::MutexLock lock(&mutex_);
    resumed_from_.push_back(request.has_resume_from() ? request.resume_from().revision() : 0);
  }
  std::vector<std::uint64_t> resumed_from() {
    absl::MutexLock lock(&mutex_);
    return resumed_from_;
  }
  /// The first version with at least this revision.
  static std::shared_ptr<const MirroredMap> WaitFor(const MapMirror& mirror,
                                                    std::uint64_t revision) {
    std::optional<MapVersion> than;
    for (;;) {
      const auto map = mirror.WaitForOther(than, kLong_s);
      EXPECT_TRUE(map.ok()) << map.status();
      if (!map.ok() || (*map)->version.revision >= revision) return map.value_or(nullptr);
      than = (*map)->version;
    }
  }

  std::atomic<std::uint64_t> epoch_{1};
  absl::Notification let_go_;
  absl::Mutex mutex_;
  std::vector<std::uint64_t> resumed_from_;
  FakeServer server_;
};

TEST_F(MirrorTest, AsksForWhatItIsToKeep) {
  absl::Notification checked;
  server_.tile.on_watch = [&](int, const auto& request, auto&, TileWriter& stream) {
    EXPECT_EQ(request.map(), "yard");
    EXPECT_EQ(request.level(), 2u);
    EXPECT_EQ(request.region().y_max(), 4);
    EXPECT_THAT(request.layers(), ElementsAre(v1::LAYER_ELEVATION, v1::LAYER_TRAVERSABILITY));
    EXPECT_EQ(request.encoding(), v1::CELL_ENCODING_COMPACT);
    EXPECT_EQ(request.min_interval_s(), 0.5);
    EXPECT_EQ(request.bytes_per_s_max(), 5000u);
    EXPECT_FALSE(request.has_resume_from());
    EXPECT_FALSE(request.keys_only());
    checked.Notify();
    (void)stream;
    return Stay();
  };
  MirrorOptions options = Options();
  options.level = 2;
  options.region = Region{1, 2, 3, 4};
  options.min_interval_s = 0.5;
  options.bytes_per_s_max = 5000;
  const MapMirror mirror(server_.Connect(), options);
  checked.WaitForNotification();
  EXPECT_EQ(mirror.map(), nullptr);
}

TEST_F(MirrorTest, ComesBackWithWhatIsCompleteAndDropsHalfAChange) {
  server_.tile.on_watch = [&](int number, const auto& request, auto&,
                              TileWriter& stream) -> grpc::Status {
    Note(request);
    if (number == 1) {
      stream.Write(Snapshot(1, 10, 1));
      stream.Write(Change(1, 10, 11, 2));
      stream.Write(Change(1, 11, 12, 99, false));
      return {grpc::StatusCode::UNAVAILABLE, "the link broke"};
    }
    v1::WatchTilesResponse change = Change(1, 11, 14, 4);
    change.set_num_versions_skipped(2);
    stream.Write(change);
    return Stay();
  };
  std::vector<std::pair<std::uint64_t, std::size_t>> told;
  MirrorOptions options = Options();
  options.on_version = [&](const auto& map, const auto& changed) {
    absl::MutexLock lock(&mutex_);
    told.emplace_back(map->version.revision, changed.size());
  };
  {
    const MapMirror mirror(server_.Connect(), options);
    const auto map = WaitFor(mirror, 14);
    ASSERT_NE(map, nullptr);
    EXPECT_EQ(map->ValueAt(Layer::kElevation, {1, 1}), 4);
    EXPECT_EQ(map->cell_size_m, 0.5);
    EXPECT_TRUE(map->IsFree({1, 1}));
    EXPECT_THAT(resumed_from(), ElementsAre(0, 11));
    const MirrorStats stats = mirror.stats();
    EXPECT_EQ(stats.num_versions, 3u);
    EXPECT_EQ(stats.num_versions_skipped, 2u);
    EXPECT_EQ(stats.num_resyncs, 0u);
    EXPECT_GT(stats.received_bytes, 4 * 128u * 128);
    EXPECT_THAT(std::string(stats.error.message()), HasSubstr("the link broke"));
  }
  EXPECT_THAT(told, ElementsAre(std::pair(10, 1), std::pair(11, 1), std::pair(14, 1)));
}

// It waited for ever for the end of a stream that the server keeps open.
TEST_F(MirrorTest, LeavesAStreamWithADamagedAnswer) {
  server_.tile.on_watch = [&](int stream_number, const auto&, auto&, TileWriter& stream) {
    if (stream_number == 1) {
      v1::WatchTilesResponse damaged;
      damaged.GetReflection()->MutableUnknownFields(&damaged)->AddLengthDelimited(
          v1::WatchTilesResponse::kTilesFieldNumber, "\xff");
      stream.Write(damaged);
    } else {
      stream.Write(Snapshot(1, 7, 3));
    }
    return Stay();
  };
  const MapMirror mirror(server_.Connect(), Options());
  EXPECT_NE(WaitFor(mirror, 7), nullptr);
}

// A change of something else than what is held would be applied to the wrong cells.
TEST_F(MirrorTest, StartsOverWhenAChangeIsNotOfWhatItHolds) {
  server_.tile.on_watch = [&](int number, const auto& request, auto&, TileWriter& stream) {
    Note(request);
    if (number == 1) {
      stream.Write(Snapshot(1, 10, 1));
      stream.Write(Change(1, 9, 12, 99));
      return Stay();
    }
    stream.Write(Snapshot(1, 13, 3));
    return Stay();
  };
  const MapMirror mirror(server_.Connect(), Options());
  const auto map = WaitFor(mirror, 13);
  ASSERT_NE(map, nullptr);
  EXPECT_EQ(map->ValueAt(Layer::kElevation, {1, 1}), 3);
  EXPECT_THAT(resumed_from(), ElementsAre(0, 0));
  EXPECT_EQ(mirror.stats().num_resyncs, 1u);
}

TEST_F(MirrorTest, FollowsAServerThatWasRestarted) {
  server_.tile.on_watch = [&](int number, const auto& request, auto&,
                              TileWriter& stream) -> grpc::Status {
    Note(request);
    if (number == 1) {
      stream.Write(Snapshot(1, 10, 1));
      epoch_ = 2;
      return {grpc::StatusCode::UNAVAILABLE, "going away"};
    }
    stream.Write(Snapshot(2, 30, 2));
    return Stay();
  };
  const MapMirror mirror(server_.Connect(), Options());
  const auto map = WaitFor(mirror, 30);
  ASSERT_NE(map, nullptr);
  EXPECT_EQ(map->version.epoch, 2u);
  EXPECT_THAT(resumed_from(), ElementsAre(0, 10)) << "the server decides what it is worth";
}

TEST_F(MirrorTest, WaitsForAMapThatIsNotThereYet) {
  std::atomic<int> num_asked{0};
  const auto on_matrix = server_.tile.on_matrix;
  server_.tile.on_matrix = [&](const auto& request, auto& response) -> grpc::Status {
    if (++num_asked < 3) return {grpc::StatusCode::NOT_FOUND, "map is yard, want one that exists"};
    return on_matrix(request, response);
  };
  server_.tile.on_watch = [&](int, const auto&, auto&, TileWriter& stream) {
    stream.Write(Snapshot(1, 1, 1));
    return Stay();
  };
  const MapMirror mirror(server_.Connect(), Options());
  EXPECT_NE(WaitFor(mirror, 1), nullptr);
  EXPECT_EQ(num_asked, 3);
}

TEST_F(MirrorTest, EndsWhenAskingAgainIsOfNoUse) {
  std::atomic<int> num_asked{0};
  server_.tile.on_watch = [&](int, const auto&, auto&, TileWriter&) -> grpc::Status {
    ++num_asked;
    return {grpc::StatusCode::INVALID_ARGUMENT, "level is 9, want 0 to 6"};
  };
  const MapMirror mirror(server_.Connect(), Options());
  const auto map = mirror.WaitForOther(std::nullopt, kLong_s);
  EXPECT_TRUE(absl::IsInvalidArgument(map.status())) << map.status();
  EXPECT_TRUE(mirror.stats().ended);
  EXPECT_EQ(num_asked, 1);
}

TEST_F(MirrorTest, EndsAtTheLimitOfTiles) {
  server_.tile.on_watch = [&](int, const auto&, auto&, TileWriter& stream) {
    v1::WatchTilesResponse response = Snapshot(1, 1, 1);
    AddTile(1, 1, response);
    stream.Write(response);
    return Stay();
  };
  MirrorOptions options = Options();
  options.tiles_max = 1;
  const MapMirror mirror(server_.Connect(), options);
  const auto map = mirror.WaitForOther(std::nullopt, kLong_s);
  EXPECT_TRUE(absl::IsResourceExhausted(map.status())) << map.status();
  EXPECT_THAT(std::string(map.status().message()), HasSubstr("more than 1 tiles"));
}

TEST_F(MirrorTest, ShowsNothingOfATileThatLacksALayer) {
  server_.tile.on_watch = [&](int number, const auto&, auto&, TileWriter& stream) {
    v1::WatchTilesResponse response = Snapshot(1, static_cast<std::uint64_t>(number), 1);
    if (number == 1) response.mutable_tiles(0)->mutable_grid()->mutable_layers()->RemoveLast();
    stream.Write(response);
    return Stay();
  };
  const MapMirror mirror(server_.Connect(), Options());
  const auto map = mirror.WaitForOther(std::nullopt, kLong_s);
  ASSERT_TRUE(map.ok()) << map.status();
  EXPECT_EQ((*map)->version.revision, 2u);
  EXPECT_THAT(std::string(mirror.stats().error.message()),
              HasSubstr("a tile without layer traversability"));
}

TEST_F(MirrorTest, SubscribesToLocalMapsAcrossStreams) {
  server_.tile.on_watch_local_map = [&](int number, const v1::WatchLocalMapRequest& request, auto&,
                                        auto& stream) -> grpc::Status {
    EXPECT_EQ(request.robot(), "rover");
    EXPECT_EQ(request.min_interval_s(), 0.25);
    v1::WatchLocalMapResponse response;
    v1::LocalMap& map = *response.mutable_local_map();
    map.set_seq(static_cast<std::uint64_t>(number));
    wire::ToProto(Pose<Odom, Base>(), map.mutable_odom_from_base());
    wire::ToProto(Pose<Global, Odom>(), map.mutable_map_from_odom());
    wire::ToProto(FlatGrid(4, 1.5f), wire::CellEncoding::kRaw, map.mutable_grid());
    response.set_num_skipped(3);
    stream.Write(response);
    if (number == 1) return {grpc::StatusCode::UNAVAILABLE, "the link broke"};
    return Stay();
  };
  SubscriberOptions options;
  options.robot = "rover";
  options.min_interval_s = 0.25;
  options.retry = {1e-3, 1e-3};
  std::atomic<int> num_told{0};
  options.on_map = [&](const auto&) { ++num_told; };
  {
    const LocalMapSubscriber subscriber(server_.Connect(), options);
    auto map = subscriber.WaitForOther(nullptr, kLong_s);
    while (map.ok() && (*map)->seq < 2) map = subscriber.WaitForOther(*map, kLong_s);
    ASSERT_TRUE(map.ok()) << map.status();
    EXPECT_EQ((*map)->grid.Find(Layer::kElevation)->values[15], 1.5f);
    EXPECT_EQ(subscriber.map(), *map);
    EXPECT_EQ(subscriber.stats().num_maps, 2u);
    EXPECT_EQ(subscriber.stats().num_skipped, 6u);
  }
  EXPECT_EQ(num_told, 2);
}

}  // namespace
}  // namespace gem::client
