#include "client/map_client.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "google/rpc/error_details.pb.h"
#include "proto/wire/grid.h"
#include "proto/wire/pose.h"
#include "tests/client/fake_server.h"

namespace gem::client {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

/// Elevation `height_m` in every cell.
LayeredGrid FlatGrid(std::int32_t side, float height_m) {
  LayeredGrid grid{side, side, 0.5, {}};
  grid.layers.push_back({Layer::kElevation,
                         std::vector<std::uint8_t>(grid.num_cells(), 1),
                         std::vector<float>(grid.num_cells(), height_m),
                         {}});
  return grid;
}

void SetVersion(std::uint64_t revision, v1::MapVersion* version) {
  version->set_epoch(1);
  version->set_revision(revision);
}

/// Answers each tile with its x as height.
grpc::Status Serve(const v1::BatchGetTilesRequest& request, std::uint64_t revision,
                   v1::BatchGetTilesResponse& response) {
  for (const v1::TileKey& key : request.tiles()) {
    v1::Tile& tile = *response.add_tiles();
    *tile.mutable_key() = key;
    SetVersion(1, tile.mutable_version());
    wire::ToProto(FlatGrid(kTileCells, static_cast<float>(key.x())), wire::CellEncoding::kRaw,
                  tile.mutable_grid());
  }
  SetVersion(revision, response.mutable_version());
  return grpc::Status::OK;
}

std::vector<TileIndex> Row(int num_tiles) {
  std::vector<TileIndex> tiles;
  for (int x = 0; x < num_tiles; ++x) tiles.push_back({x, -1});
  return tiles;
}

class MapClientTest : public ::testing::Test {
 protected:
  MapClient Client(MapClientOptions options = {}) { return MapClient(server_.Connect(), options); }

  FakeServer server_;
};

TEST_F(MapClientTest, ReadsTilesInBatchesOf64) {
  std::vector<int> batches;
  server_.tile.on_tiles = [&](const auto& request, auto& response) {
    batches.push_back(request.tiles_size());
    EXPECT_EQ(request.map(), "yard");
    EXPECT_EQ(request.encoding(), v1::CELL_ENCODING_RAW);
    return Serve(request, 3, response);
  };
  const auto set = Client().GetTiles("yard", Row(130), {{Layer::kElevation}, CellEncoding::kRaw});
  ASSERT_TRUE(set.ok()) << set.status();
  EXPECT_THAT(batches, ElementsAre(64, 64, 2));
  ASSERT_EQ(set->tiles.size(), 130u);
  EXPECT_EQ(set->version, (MapVersion{1, 3}));
  EXPECT_EQ(set->tiles[129].index, (TileIndex{129, -1}));
  EXPECT_EQ(set->tiles[129].grid->Find(Layer::kElevation)->values[0], 129);
}

grpc::Status Expired() {
  google::rpc::ErrorInfo info;
  info.set_reason("REVISION_EXPIRED");
  google::rpc::Status details;
  details.add_details()->PackFrom(info);
  return {grpc::StatusCode::FAILED_PRECONDITION, "at is revision 1, which is not kept any more",
          details.SerializeAsString()};
}

// The map may change between two batches: those after the first are pinned to its version.
TEST_F(MapClientTest, ReadsAllBatchesOfTheVersionOfTheFirst) {
  std::vector<std::uint64_t> asked;
  server_.tile.on_tiles = [&](const auto& request, auto& response) {
    asked.push_back(request.has_at() ? request.at().revision() : 0);
    return Serve(request, request.has_at() ? request.at().revision() : 7, response);
  };
  const auto set = Client().GetTiles("yard", Row(130), {});
  ASSERT_TRUE(set.ok()) << set.status();
  EXPECT_THAT(asked, ElementsAre(0, 7, 7));
  EXPECT_EQ(set->version.revision, 7u);
}

TEST_F(MapClientTest, BeginsAnewWhenTheVersionIsForgottenBetweenBatches) {
  int num_calls = 0;
  server_.tile.on_tiles = [&](const auto& request, auto& response) {
    return ++num_calls == 2 ? Expired() : Serve(request, num_calls == 1 ? 1 : 2, response);
  };
  const auto set = Client().GetTiles("yard", Row(65), {});
  ASSERT_TRUE(set.ok()) << set.status();
  EXPECT_EQ(num_calls, 4);
  EXPECT_EQ(set->version.revision, 2u);
  EXPECT_EQ(set->tiles.size(), 65u);
}

TEST_F(MapClientTest, StopsReadingAMapWhoseVersionsAreForgottenTooFast) {
  int num_calls = 0;
  server_.tile.on_tiles = [&](const auto& request, auto& response) {
    return ++num_calls % 2 == 0 ? Expired() : Serve(request, 1, response);
  };
  MapClientOptions options;
  options.consistent_tries_max = 3;
  const auto set = Client(options).GetTiles("yard", Row(65), {});
  EXPECT_TRUE(absl::IsAborted(set.status())) << set.status();
  EXPECT_THAT(std::string(set.status().message()), HasSubstr("was forgotten 3 times"));
  EXPECT_EQ(num_calls, 6);
}

// Who asked for a version by name must not get another one.
TEST_F(MapClientTest, APinnedVersionThatIsForgottenIsAnError) {
  int num_calls = 0;
  server_.tile.on_tiles = [&](const auto& request, auto&) {
    ++num_calls;
    EXPECT_EQ(request.at().epoch(), 1u);
    EXPECT_EQ(request.at().revision(), 4u);
    return Expired();
  };
  const auto set = Client().GetTiles("yard", Row(1), {}, {0, MapVersion{1, 4}});
  EXPECT_TRUE(absl::IsFailedPrecondition(set.status())) << set.status();
  EXPECT_EQ(num_calls, 1);
}

TEST_F(MapClientTest, RefusesTilesOfAnotherVersionThanThePinnedOne) {
  server_.tile.on_tiles = [&](const auto& request, auto& response) {
    return Serve(request, 5, response);
  };
  EXPECT_THAT(
      std::string(Client().GetTiles("yard", Row(1), {}, {0, MapVersion{1, 4}}).status().message()),
      HasSubstr("tiles of revision 5 instead of 4"));
}

TEST_F(MapClientTest, TakesTilesThatDidNotChangeFromWhatIsHeld) {
  server_.tile.on_tiles = [&](const auto& request, auto& response) {
    EXPECT_EQ(request.if_none_match_size(), 0);
    const grpc::Status status = Serve(request, 1, response);
    for (v1::Tile& tile : *response.mutable_tiles())
      tile.set_etag(static_cast<std::uint64_t>(100 + tile.key().x()));
    return status;
  };
  const auto before = Client().GetTiles("yard", Row(2), {});
  ASSERT_TRUE(before.ok()) << before.status();
  EXPECT_EQ(before->tiles[1].etag, 101u);
  server_.tile.on_tiles = [&](const auto& request, auto& response) {
    EXPECT_EQ(request.if_none_match_size(), 3);
    EXPECT_EQ(request.if_none_match(1), 101u);
    EXPECT_EQ(request.if_none_match(2), 0u) << "not held";
    const grpc::Status status = Serve(request, 2, response);
    response.mutable_tiles(0)->set_etag(200);
    response.mutable_tiles(1)->set_not_modified(true);
    response.mutable_tiles(1)->set_etag(101);
    return status;
  };
  const auto after = Client().GetTiles("yard", Row(3), {}, {0, std::nullopt, &*before});
  ASSERT_TRUE(after.ok()) << after.status();
  EXPECT_NE(after->tiles[0].grid, before->tiles[0].grid);
  EXPECT_EQ(after->tiles[1].grid, before->tiles[1].grid) << "the same cells, not a copy";
  EXPECT_EQ(after->tiles[1].etag, 101u);
  ASSERT_NE(after->tiles[2].grid, nullptr);
}

TEST_F(MapClientTest, RefusesNotModifiedForWhatIsNotHeld) {
  server_.tile.on_tiles = [&](const auto& request, auto& response) {
    const grpc::Status status = Serve(request, 1, response);
    response.mutable_tiles(0)->set_not_modified(true);
    return status;
  };
  EXPECT_THAT(std::string(Client().GetTiles("yard", Row(1), {}).status().message()),
              HasSubstr("as not modified, which it is not"));
}

TEST_F(MapClientTest, ReadsMatrixAndTilesOfOneVersion) {
  std::uint64_t revision = 0;
  server_.tile.on_matrix = [&](const auto&, auto& response) {
    response.set_cell_size_m(0.5);
    response.set_tile_cells(128);
    // The map grows by a tile with each version.
    for (std::uint64_t x = 0; x <= revision; ++x)
      response.add_tiles()->set_x(static_cast<std::int32_t>(x));
    SetVersion(revision, response.mutable_version());
    return grpc::Status::OK;
  };
  bool forgotten = true;
  server_.tile.on_tiles = [&](const auto& request, auto& response) {
    // Between the two calls the map changes, and the first time it forgets what it was.
    ++revision;
    if (std::exchange(forgotten, false)) return Expired();
    return Serve(request, request.at().revision(), response);
  };
  const auto map = Client().ReadMap("yard", std::nullopt, {});
  ASSERT_TRUE(map.ok()) << map.status();
  EXPECT_EQ(map->matrix.version, map->tiles.version);
  EXPECT_EQ(map->tiles.version.revision, 1u);
  EXPECT_EQ(map->tiles.tiles.size(), 2u);
}

TEST_F(MapClientTest, ReadsOnlyTheTilesThatTheRegionTouches) {
  server_.tile.on_matrix = [&](const auto&, auto& response) {
    response.set_cell_size_m(0.5);  // tiles of 64 m
    response.set_tile_cells(128);
    for (int x = -2; x <= 2; ++x) response.add_tiles()->set_x(x);
    SetVersion(1, response.mutable_version());
    return grpc::Status::OK;
  };
  std::vector<int> xs;
  server_.tile.on_tiles = [&](const auto& request, auto& response) {
    for (const auto& key : request.tiles()) xs.push_back(key.x());
    return Serve(request, 1, response);
  };
  // x from -1 m to exactly the border of tile 1.
  ASSERT_TRUE(Client().ReadMap("yard", Region{-1, 0, 64, 10}, {}).ok());
  EXPECT_THAT(xs, ElementsAre(-1, 0));
}

TEST_F(MapClientTest, RefusesATileThatWasNotAskedFor) {
  server_.tile.on_tiles = [&](const auto& request, auto& response) {
    const grpc::Status status = Serve(request, 1, response);
    response.mutable_tiles(0)->mutable_key()->set_x(99);
    return status;
  };
  EXPECT_THAT(std::string(Client().GetTiles("yard", Row(1), {}).status().message()),
              HasSubstr("tile (0, 99, -1) instead of (0, 0, -1)"));
}

TEST_F(MapClientTest, RefusesATileWithoutTheLayerOrOfAnotherSize) {
  server_.tile.on_tiles = [&](const auto& request, auto& response) {
    return Serve(request, 1, response);
  };
  EXPECT_THAT(std::string(Client()
                              .GetTiles("yard", Row(1), {{Layer::kVariance}, CellEncoding::kRaw})
                              .status()
                              .message()),
              HasSubstr("a tile without layer variance"));
  server_.tile.on_tiles = [&](const auto& request, auto& response) {
    const grpc::Status status = Serve(request, 1, response);
    response.mutable_tiles(0)->clear_grid();
    wire::ToProto(FlatGrid(4, 0), wire::CellEncoding::kRaw,
                  response.mutable_tiles(0)->mutable_grid());
    return status;
  };
  // Which of the two checks finds it does not matter, but it must not get through.
  EXPECT_FALSE(Client().GetTiles("yard", Row(1), {}).ok());
}

TEST_F(MapClientTest, KnowsAnAbsentTileFromAnEmptyOne) {
  server_.tile.on_tiles = [&](const auto& request, auto& response) {
    const grpc::Status status = Serve(request, 1, response);
    response.mutable_tiles(0)->set_absent(true);
    return status;
  };
  const auto set = Client().GetTiles("yard", Row(2), {});
  ASSERT_TRUE(set.ok()) << set.status();
  EXPECT_EQ(set->tiles[0].grid, nullptr);
  EXPECT_NE(set->tiles[1].grid, nullptr);
}

TEST_F(MapClientTest, ReadsTheLocalMapWithItsPoses) {
  server_.tile.on_local_map = [&](const auto& request, auto& response) {
    EXPECT_EQ(request.robot(), "rover");
    v1::LocalMap& map = *response.mutable_local_map();
    map.set_seq(12);
    map.set_stamp_ns(34);
    map.set_origin_cell_x(-20);
    map.set_origin_cell_y(7);
    map.set_session("monday");
    map.set_traversability_free(0.7f);
    wire::ToProto(Pose<Odom, Base>::FromTranslation(1, 2, 3), map.mutable_odom_from_base());
    wire::ToProto(Pose<Global, Odom>::FromTranslation(4, 5, 6), map.mutable_map_from_odom());
    wire::ToProto(FlatGrid(40, 1.5f), wire::CellEncoding::kRaw, map.mutable_grid());
    return grpc::Status::OK;
  };
  const auto map = Client().GetLocalMap("rover", {});
  ASSERT_TRUE(map.ok()) << map.status();
  EXPECT_EQ(map->origin, (CellIndex{-20, 7}));
  EXPECT_EQ(map->seq, 12u);
  EXPECT_EQ(map->T_O_B.translation().z(), 3);
  EXPECT_EQ(map->T_G_O.translation().x(), 4);
  EXPECT_EQ(map->grid.Find(Layer::kElevation)->values[1599], 1.5f);
}

TEST_F(MapClientTest, FollowsThePagesOfMaps) {
  server_.map.on_maps = [&](const auto& request, auto& response) {
    response.add_maps()->set_id(request.page_token().empty() ? "a" : "b");
    if (request.page_token().empty()) response.set_next_page_token("a");
    return grpc::Status::OK;
  };
  const auto maps = Client().ListMaps();
  ASSERT_TRUE(maps.ok()) << maps.status();
  ASSERT_EQ(maps->size(), 2u);
  EXPECT_EQ((*maps)[1].id, "b");
}

TEST_F(MapClientTest, ReadsPagesOfSubmapsAgainWhenTheMapChangesBetweenThem) {
  std::vector<std::uint64_t> revisions = {1, 2, 2, 2};
  std::size_t num_calls = 0;
  server_.map.on_submaps = [&](const auto& request, auto& response) {
    v1::Submap& submap = *response.add_submaps();
    submap.set_id(request.page_token().empty() ? 1 : 2);
    wire::ToProto(Pose<Global, Base>(), submap.mutable_map_from_submap());
    if (request.page_token().empty()) response.set_next_page_token("1");
    SetVersion(revisions.at(num_calls++), response.mutable_version());
    return grpc::Status::OK;
  };
  const auto submaps = Client().ListSubmaps("yard");
  ASSERT_TRUE(submaps.ok()) << submaps.status();
  EXPECT_EQ(num_calls, 4u);
  ASSERT_EQ(submaps->size(), 2u);
  EXPECT_EQ((*submaps)[0].id, 1u);
  EXPECT_EQ((*submaps)[1].id, 2u);
}

TEST_F(MapClientTest, SendsACorrectionAgainUnderTheSameRequestId) {
  std::vector<std::string> ids;
  server_.ingest.on_correct = [&](const auto& request, auto& response) -> grpc::Status {
    ids.push_back(request.request_id());
    EXPECT_EQ(request.poses(0).stamp_ns(), 5);
    EXPECT_EQ(request.poses(0).map_from_base().x(), 7);
    if (ids.size() == 1) return {grpc::StatusCode::UNAVAILABLE, "draining"};
    response.set_num_moved_submaps(3);
    SetVersion(8, response.mutable_version());
    return grpc::Status::OK;
  };
  const auto result = Client().CorrectTrajectory(
      {"yard", "monday", "", {{5, Pose<Global, Base>::FromTranslation(7, 0, 0)}}});
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_EQ(result->num_moved_submaps, 3u);
  EXPECT_EQ(result->version, (MapVersion{1, 8}));
  ASSERT_EQ(ids.size(), 2u);
  EXPECT_EQ(ids[0].size(), 16u);
  EXPECT_EQ(ids[0], ids[1]);
}

TEST_F(MapClientTest, DoesNotRepeatACorrectionThatIsRefused) {
  int num_calls = 0;
  server_.ingest.on_correct = [&](const auto&, auto&) -> grpc::Status {
    ++num_calls;
    return {grpc::StatusCode::NOT_FOUND, "session is \"monday\", want one of map yard"};
  };
  const auto result =
      Client().CorrectTrajectory({"yard", "monday", "id", {{5, Pose<Global, Base>()}}});
  EXPECT_TRUE(absl::IsNotFound(result.status()));
  EXPECT_THAT(std::string(result.status().message()), HasSubstr("session is \"monday\""));
  EXPECT_EQ(num_calls, 1);
}

TEST_F(MapClientTest, TellsTheServersState) {
  server_.map.on_status = [&](const auto&, auto& response) {
    response.set_backend("cpu");
    v1::SessionStatus& session = *response.add_sessions();
    session.set_session("monday");
    session.set_active(true);
    session.set_num_scans_fused(10);
    v1::StageTiming& timing = *response.add_timings();
    timing.set_mapper("local");
    timing.set_stage("fuse");
    timing.set_count(10);
    timing.set_total_s(0.5);
    timing.add_buckets()->set_upper_s(0.1);
    v1::CallStatus& call = *response.add_calls();
    call.set_method("GetMap");
    call.set_num_started(7);
    call.set_num_failed(2);
    call.set_sent_bytes(900);
    call.add_buckets()->set_count(6);
    v1::MapLag& lag = *response.add_lags();
    lag.set_map("yard");
    lag.set_staleness_s(1.5);
    lag.set_num_corrections_waiting(3);
    response.mutable_process()->set_resident_bytes(1 << 20);
    response.mutable_process()->set_num_threads(9);
    response.mutable_tiles()->set_num_absent(4);
    return grpc::Status::OK;
  };
  const auto status = Client().GetServerStatus();
  ASSERT_TRUE(status.ok()) << status.status();
  EXPECT_EQ(status->backend, "cpu");
  ASSERT_EQ(status->sessions.size(), 1u);
  EXPECT_TRUE(status->sessions[0].active);
  EXPECT_EQ(status->sessions[0].num_scans_fused, 10u);
  ASSERT_EQ(status->timings.size(), 1u);
  EXPECT_EQ(status->timings[0].total_s, 0.5);
  ASSERT_EQ(status->timings[0].buckets.size(), 1u);
  EXPECT_EQ(status->timings[0].buckets[0].upper_s, 0.1);
  ASSERT_EQ(status->calls.size(), 1u);
  EXPECT_EQ(status->calls[0].method, "GetMap");
  EXPECT_EQ(status->calls[0].num_started, 7u);
  EXPECT_EQ(status->calls[0].num_failed, 2u);
  EXPECT_EQ(status->calls[0].sent_bytes, 900u);
  ASSERT_EQ(status->calls[0].buckets.size(), 1u);
  EXPECT_EQ(status->calls[0].buckets[0].count, 6u);
  ASSERT_EQ(status->lags.size(), 1u);
  EXPECT_EQ(status->lags[0].map, "yard");
  EXPECT_EQ(status->lags[0].staleness_s, 1.5);
  EXPECT_EQ(status->lags[0].num_corrections_waiting, 3u);
  EXPECT_EQ(status->process.resident_bytes, 1u << 20);
  EXPECT_EQ(status->process.num_threads, 9u);
  EXPECT_EQ(status->tiles.num_absent, 4u);
}

TEST_F(MapClientTest, RefusesAGeometryItDoesNotKnow) {
  server_.tile.on_matrix = [&](const auto&, auto& response) {
    response.set_cell_size_m(0.5);
    response.set_tile_cells(256);
    return grpc::Status::OK;
  };
  EXPECT_THAT(std::string(Client().GetTileMatrix("yard").status().message()),
              HasSubstr("tiles of 256 cells a side, want 128"));
  server_.tile.on_matrix = [&](const auto&, auto& response) {
    response.set_cell_size_m(-1);
    response.set_tile_cells(128);
    return grpc::Status::OK;
  };
  EXPECT_THAT(std::string(Client().GetTileMatrix("yard").status().message()),
              HasSubstr("cells of -1 m"));
}

}  // namespace
}  // namespace gem::client
