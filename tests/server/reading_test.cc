// TileService and MapService: what readers get, paging, refusals.
#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <string>

#include "tests/server/test_server.h"

namespace gem {
namespace {

using testing::ElementsAre;

/// A map "site" with one ended session "s1" of robot "r1": 10 m x 8 m of ground around x = 1.
class Reading : public testing::Test {
 protected:
  Reading() {
    v1::OpenSession open = TestOpen("r1", "s1");
    open.mutable_map_setup()->set_submap_length_m(1);
    TestStream robot(server_.ingest(), open);
    for (std::uint64_t seq = 1; seq <= 5; ++seq)
      EXPECT_TRUE(robot.Send(FlatScan(seq, 0.5 * static_cast<double>(seq - 1))));
    EXPECT_TRUE(robot.SendClose());
    EXPECT_TRUE(robot.ReadUntilClosed());
    WaitUntilEnded("Ingest");
  }

  /// The server is done with a call a little later than its client.
  void WaitUntilEnded(const std::string& method) {
    constexpr int kLooksMax = 10'000;
    for (int look = 0; look < kLooksMax; ++look) {
      v1::GetServerStatusResponse response;
      ASSERT_TRUE(Get(server_.maps(), &v1::MapService::Stub::GetServerStatus,
                      v1::GetServerStatusRequest(), response)
                      .ok());
      const auto call = std::find_if(response.calls().begin(), response.calls().end(),
                                     [&](const auto& c) { return c.method() == method; });
      if (call == response.calls().end() || call->num_active() == 0) return;
    }
    FAIL() << method << " never ends";
  }

  template <typename Response, typename Stub, typename Request>
  grpc::Status Get(Stub& stub,
                   grpc::Status (Stub::*method)(grpc::ClientContext*, const Request&, Response*),
                   const Request& request, Response& response) {
    return TestServer::Call(stub, method, request, response);
  }

  TestServer server_;
};

TEST_F(Reading, TheTileMatrixListsTheTilesByRowThenColumn) {
  v1::GetTileMatrixRequest request;
  request.set_map("site");
  v1::GetTileMatrixResponse response;
  ASSERT_TRUE(Get(server_.tiles(), &v1::TileService::Stub::GetTileMatrix, request, response).ok());
  EXPECT_EQ(response.cell_size_m(), 0.5);
  EXPECT_EQ(response.tile_cells(), 128u);
  EXPECT_EQ(response.traversability_free(), 0.7f);
  EXPECT_THAT(response.layers(),
              ElementsAre(v1::LAYER_ELEVATION, v1::LAYER_VARIANCE, v1::LAYER_TRAVERSABILITY,
                          v1::LAYER_COLOR, v1::LAYER_AGE));
  // The ground lies around the origin: one tile in each quadrant.
  std::vector<std::pair<int, int>> keys;
  for (const v1::TileKey& key : response.tiles()) keys.emplace_back(key.x(), key.y());
  EXPECT_THAT(keys,
              ElementsAre(std::pair(-1, -1), std::pair(0, -1), std::pair(-1, 0), std::pair(0, 0)));
}

TEST_F(Reading, TilesComeInTheOrderOfTheRequestAndAbsentOnesSaySo) {
  v1::BatchGetTilesRequest request;
  request.set_map("site");
  request.add_tiles()->set_x(7);
  request.add_tiles();
  request.add_layers(v1::LAYER_TRAVERSABILITY);
  request.set_encoding(v1::CELL_ENCODING_COMPACT);
  v1::BatchGetTilesResponse response;
  ASSERT_TRUE(Get(server_.tiles(), &v1::TileService::Stub::BatchGetTiles, request, response).ok());
  ASSERT_EQ(response.tiles_size(), 2);
  EXPECT_TRUE(response.tiles(0).absent());
  EXPECT_EQ(response.tiles(0).key().x(), 7);
  const auto tile = wire::FromProto(response.tiles(1), wire::FieldPath("tile"));
  ASSERT_TRUE(tile.ok()) << tile.status();
  ASSERT_EQ(tile->grid->layers.size(), 1u);
  const GridLayer& layer = tile->grid->layers[0];
  EXPECT_EQ(layer.layer, Layer::kTraversability);
  // The cell at the origin is flat ground.
  EXPECT_EQ(layer.valid[0], 1);
  EXPECT_GT(layer.values[0], 0.99f);
}

TEST_F(Reading, CoarserLevelsHaveTilesToo) {
  v1::BatchGetTilesRequest request;
  request.set_map("site");
  request.add_tiles()->set_level(2);
  v1::BatchGetTilesResponse response;
  ASSERT_TRUE(Get(server_.tiles(), &v1::TileService::Stub::BatchGetTiles, request, response).ok());
  const auto tile = wire::FromProto(response.tiles(0), wire::FieldPath("tile"));
  ASSERT_TRUE(tile.ok()) << tile.status();
  EXPECT_EQ(tile->address, (TileAddress{2, {0, 0}}));
  ASSERT_TRUE(tile->grid.has_value());
  EXPECT_EQ(tile->grid->cell_size_m, 4 * 0.5);
  EXPECT_EQ(tile->grid->layers[0].valid[0], 1);
}

TEST_F(Reading, RefusesTileRequestsByName) {
  const auto refused = [&](const std::function<void(v1::BatchGetTilesRequest&)>& spoil) {
    v1::BatchGetTilesRequest request;
    request.set_map("site");
    request.add_tiles();
    spoil(request);
    v1::BatchGetTilesResponse response;
    const grpc::Status status =
        Get(server_.tiles(), &v1::TileService::Stub::BatchGetTiles, request, response);
    EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
    return status.error_message();
  };
  EXPECT_EQ(refused([](auto& r) { r.clear_tiles(); }), "tiles is 0 tiles, want 1 to 64");
  EXPECT_EQ(refused([](auto& r) {
              for (int i = 0; i < 64; ++i) r.add_tiles();
            }),
            "tiles is 65 tiles, want 1 to 64");
  EXPECT_EQ(refused([](auto& r) { r.mutable_tiles(0)->set_level(7); }),
            "tiles[0].level is 7, want 0 to 6");
  EXPECT_EQ(refused([](auto& r) { r.add_layers(v1::LAYER_SLOPE); }),
            "layers[0] is LAYER_SLOPE, want one of LAYER_ELEVATION LAYER_VARIANCE "
            "LAYER_TRAVERSABILITY LAYER_COLOR LAYER_AGE");
  EXPECT_EQ(refused([](auto& r) { r.set_encoding(static_cast<v1::CellEncoding>(9)); }),
            "encoding is 9, want CELL_ENCODING_RAW or CELL_ENCODING_COMPACT");
}

TEST_F(Reading, TheLocalMapOfAnEndedSessionStays) {
  v1::GetLocalMapRequest request;
  request.set_robot("r1");
  for (const v1::Layer layer : {v1::LAYER_SLOPE, v1::LAYER_ROUGHNESS, v1::LAYER_AGE})
    request.add_layers(layer);
  v1::GetLocalMapResponse response;
  ASSERT_TRUE(Get(server_.tiles(), &v1::TileService::Stub::GetLocalMap, request, response).ok());
  EXPECT_EQ(response.local_map().seq(), 5u);
  EXPECT_EQ(response.local_map().grid().layers_size(), 3);
}

TEST_F(Reading, UnknownRobotsAndRobotsWithoutAMapAreNamed) {
  v1::GetLocalMapRequest request;
  request.set_robot("nobody");
  v1::GetLocalMapResponse response;
  grpc::Status status =
      Get(server_.tiles(), &v1::TileService::Stub::GetLocalMap, request, response);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::NOT_FOUND);
  EXPECT_EQ(status.error_message(), "robot is nobody, want a robot that had a session");
  TestStream silent(server_.ingest(), TestOpen("silent", "s2"));
  request.set_robot("silent");
  status = Get(server_.tiles(), &v1::TileService::Stub::GetLocalMap, request, response);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::NOT_FOUND);
}

TEST_F(Reading, AMapSaysWhatItIsMadeOf) {
  v1::GetMapRequest request;
  request.set_map("site");
  v1::GetMapResponse response;
  ASSERT_TRUE(Get(server_.maps(), &v1::MapService::Stub::GetMap, request, response).ok());
  EXPECT_EQ(response.map().id(), "site");
  EXPECT_EQ(response.map().cell_size_m(), 0.5);
  EXPECT_EQ(response.map().submap_length_m(), 1.0);
  EXPECT_THAT(response.map().sessions(), ElementsAre("s1"));
  EXPECT_EQ(response.map().num_tiles(), 4u);
  // The window moved by four cells of 0.5 m; every cell is in exactly one submap.
  EXPECT_EQ(response.map().num_points(), 20u * 16u);
  EXPECT_GT(response.map().submap_bytes(), 0u);
  EXPECT_EQ(server_.Metric("gem_points{map=\"site\"}"), 320);
  EXPECT_EQ(server_.Metric("gem_tiles{map=\"site\"}"), 4);
  request.set_map("nowhere");
  EXPECT_EQ(Get(server_.maps(), &v1::MapService::Stub::GetMap, request, response).error_code(),
            grpc::StatusCode::NOT_FOUND);
}

TEST_F(Reading, SubmapsComeInPagesAndNoneTwice) {
  v1::ListSubmapsRequest request;
  request.set_map("site");
  v1::ListSubmapsResponse all;
  ASSERT_TRUE(Get(server_.maps(), &v1::MapService::Stub::ListSubmaps, request, all).ok());
  EXPECT_TRUE(all.next_page_token().empty());
  ASSERT_GE(all.submaps_size(), 2);
  request.set_page_size(1);
  std::vector<std::uint64_t> ids;
  do {
    v1::ListSubmapsResponse page;
    ASSERT_TRUE(Get(server_.maps(), &v1::MapService::Stub::ListSubmaps, request, page).ok());
    ASSERT_EQ(page.submaps_size(), 1);
    ids.push_back(page.submaps(0).id());
    EXPECT_EQ(page.submaps(0).session(), "s1");
    EXPECT_TRUE(page.submaps(0).finished());
    request.set_page_token(page.next_page_token());
  } while (!request.page_token().empty());
  std::vector<std::uint64_t> want;
  for (const v1::Submap& submap : all.submaps()) want.push_back(submap.id());
  EXPECT_EQ(ids, want);
}

TEST_F(Reading, MapsComeInPages) {
  std::vector<std::unique_ptr<TestStream>> robots;
  for (const char* map : {"b", "a", "c"}) {
    v1::OpenSession open = TestOpen("r2", "s1");
    open.set_map(map);
    robots.push_back(std::make_unique<TestStream>(server_.ingest(), open));
  }
  v1::ListMapsRequest request;
  request.set_page_size(3);
  v1::ListMapsResponse page;
  ASSERT_TRUE(Get(server_.maps(), &v1::MapService::Stub::ListMaps, request, page).ok());
  ASSERT_EQ(page.maps_size(), 3);
  EXPECT_EQ(page.maps(0).id(), "a");
  EXPECT_EQ(page.maps(2).id(), "c");
  request.set_page_token(page.next_page_token());
  ASSERT_TRUE(Get(server_.maps(), &v1::MapService::Stub::ListMaps, request, page).ok());
  ASSERT_EQ(page.maps_size(), 1);
  EXPECT_EQ(page.maps(0).id(), "site");
  EXPECT_TRUE(page.next_page_token().empty());
  request.set_page_size(1001);
  grpc::Status status = Get(server_.maps(), &v1::MapService::Stub::ListMaps, request, page);
  EXPECT_EQ(status.error_message(), "page_size is 1001, want at most 1000");
  request.set_page_size(1);
  request.set_page_token("\x01");
  status = Get(server_.maps(), &v1::MapService::Stub::ListMaps, request, page);
  EXPECT_EQ(status.error_message(),
            "page_token is not one of this server's, want next_page_token of the page before");
}

TEST_F(Reading, TheStatusListsSessionsAndTimings) {
  v1::GetServerStatusResponse response;
  ASSERT_TRUE(Get(server_.maps(), &v1::MapService::Stub::GetServerStatus,
                  v1::GetServerStatusRequest(), response)
                  .ok());
  EXPECT_EQ(response.backend(), "cpu");
  EXPECT_FALSE(response.server_version().empty());
  ASSERT_EQ(response.sessions_size(), 1);
  EXPECT_EQ(response.sessions(0).robot(), "r1");
  EXPECT_FALSE(response.sessions(0).active());
  EXPECT_EQ(response.sessions(0).num_scans_fused(), 5u);
  EXPECT_EQ(response.sessions(0).fused_seq(), 5u);
  EXPECT_EQ(response.sessions(0).oldest_s(), 0);
  ASSERT_EQ(response.timings_size(), 12);
  EXPECT_EQ(response.timings(0).stage(), "move");
  EXPECT_EQ(response.timings(0).count(), 5u);
  EXPECT_GE(response.timings(0).total_s(), response.timings(0).max_s());
  EXPECT_EQ(response.timings(10).stage(), "scan");
  // Every run is in a bucket, and the last one, which is infinite, counts all.
  ASSERT_GT(response.timings(10).buckets_size(), 2);
  EXPECT_EQ(response.timings(10).buckets().rbegin()->count(), 5u);
  EXPECT_TRUE(std::isinf(response.timings(10).buckets().rbegin()->upper_s()));
  EXPECT_EQ(response.timings(11).stage(), "correction");
}

TEST_F(Reading, TheStatusSaysWhatIsCalledAndHowFarMapsAreBehind) {
  v1::GetMapResponse map;
  v1::GetMapRequest no_map;
  no_map.set_map("nowhere");
  ASSERT_FALSE(Get(server_.maps(), &v1::MapService::Stub::GetMap, no_map, map).ok());
  FetchMap(server_, "site");
  v1::GetServerStatusResponse response;
  ASSERT_TRUE(Get(server_.maps(), &v1::MapService::Stub::GetServerStatus,
                  v1::GetServerStatusRequest(), response)
                  .ok());
  std::map<std::string, v1::CallStatus> calls;
  for (const v1::CallStatus& call : response.calls()) calls[call.method()] = call;
  EXPECT_EQ(calls["GetMap"].num_started(), 1u);
  EXPECT_EQ(calls["GetMap"].num_failed(), 1u);
  EXPECT_EQ(calls["BatchGetTiles"].num_failed(), 0u);
  EXPECT_GT(calls["BatchGetTiles"].sent_bytes(), 100u);
  EXPECT_EQ(calls["BatchGetTiles"].buckets().rbegin()->count(), 1u);
  EXPECT_EQ(calls["GetServerStatus"].num_active(), 1u);  // this one
  EXPECT_EQ(calls["Ingest"].num_active(), 0u);
  ASSERT_EQ(response.lags_size(), 1);
  EXPECT_EQ(response.lags(0).map(), "site");
  EXPECT_EQ(response.lags(0).staleness_s(), 0);  // the session has ended, and all of it is shown
  EXPECT_EQ(response.lags(0).num_corrections_waiting(), 0u);
  EXPECT_GT(response.process().resident_bytes(), 1u << 20);
  EXPECT_GT(response.process().num_threads(), 2u);
  EXPECT_GT(response.process().num_open_files(), 2u);
  EXPECT_GE(response.tiles().num_full(), 1u);
}

TEST_F(Reading, TheMetricsPageHasAHistogramPerStageAndCall) {
  FetchMap(server_, "site");
  const std::string page = FetchMetrics(server_.server().metrics_address());
  for (const char* stage : {"move", "measure", "fuse", "annotate", "clear"})
    EXPECT_EQ(
        MetricValue(page, std::string("gem_local_stage_seconds_count{stage=\"") + stage + "\"}"), 5)
        << stage;
  for (const char* stage : {"finish", "merge", "deform", "compose", "coarsen"})
    EXPECT_GE(
        MetricValue(page, std::string("gem_global_stage_seconds_count{stage=\"") + stage + "\"}"),
        0)
        << stage;
  EXPECT_GE(MetricValue(page, "gem_global_stage_seconds_count{stage=\"compose\"}"), 1);
  EXPECT_GE(MetricValue(page, "gem_rpc_seconds_bucket{method=\"BatchGetTiles\",le=\"0.1\"}"), 1);
  EXPECT_EQ(MetricValue(page, "gem_rpc_total{code=\"OK\",method=\"BatchGetTiles\"}"), 1);
  EXPECT_EQ(MetricValue(page, "gem_rpc_total{code=\"OK\",method=\"Ingest\"}"), 1);
  EXPECT_EQ(MetricValue(page, "gem_rpc_started_total{method=\"Ingest\"}"), 1);
  EXPECT_EQ(MetricValue(page, "gem_rpc_active_calls{method=\"Ingest\"}"), 0);
  EXPECT_EQ(MetricValue(page, "gem_scan_seconds_count"), 5);
  // 5 scans of 1024 points, each counted once.
  double points = 0;
  for (const char* outcome :
       {"fused", "gated", "outside_window", "out_of_range", "out_of_height", "on_body"})
    points += MetricValue(page, std::string("gem_scan_points_total{outcome=\"") + outcome + "\"}");
  EXPECT_EQ(points, 5 * 1024);
}

TEST_F(Reading, ThePageCountsBytesAndTilesOfAnswers) {
  v1::BatchGetTilesRequest request;
  request.set_map("site");
  for (const int x : {0, 1000}) request.add_tiles()->set_x(x);
  v1::BatchGetTilesResponse response;
  ASSERT_TRUE(
      TestServer::Call(server_.tiles(), &v1::TileService::Stub::BatchGetTiles, request, response)
          .ok());
  EXPECT_EQ(server_.Metric("gem_tiles_served_total{outcome=\"full\"}"), 1);
  EXPECT_EQ(server_.Metric("gem_tiles_served_total{outcome=\"absent\"}"), 1);
  const std::string calls = "gem_rpc_bytes_total{direction=\"";
  EXPECT_EQ(server_.Metric(calls + "received\",method=\"BatchGetTiles\"}"), request.ByteSizeLong());
  EXPECT_EQ(server_.Metric(calls + "sent\",method=\"BatchGetTiles\"}"), response.ByteSizeLong());
  // 5 scans of 1024 points of 12 bytes, and little else.
  const double ingested = server_.Metric(calls + "received\",method=\"Ingest\"}");
  EXPECT_GE(ingested, 5 * 1024 * 12);
  EXPECT_LT(ingested, 5 * 1024 * 12 * 1.1);
}

TEST_F(Reading, AMapThatShowsEverythingIsNotStale) {
  EXPECT_EQ(server_.Metric("gem_map_staleness_seconds{map=\"site\"}"), 0);
  EXPECT_EQ(server_.Metric("gem_waiting_corrections{map=\"site\"}"), 0);
  EXPECT_EQ(server_.Metric("gem_correction_oldest_seconds{map=\"site\"}"), 0);
  EXPECT_GE(server_.Metric("gem_map_revision_age_seconds{map=\"site\"}"), 0);
}

}  // namespace
}  // namespace gem
