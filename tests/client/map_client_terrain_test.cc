// MapClient: questions about the ground.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

#include "client/map_client.h"
#include "tests/client/fake_server.h"

namespace gem::client {
namespace {

using ::testing::HasSubstr;

TEST(MapClientTerrain, AsksForHeightsOnAVersionAndTellsWhichItGot) {
  FakeServer server;
  server.terrain.on_heights = [](const auto& request, auto& response) {
    EXPECT_EQ(request.map(), "yard");
    EXPECT_EQ(request.points_size(), 2);
    EXPECT_EQ(request.points(1).y(), -4);
    EXPECT_EQ(request.at().epoch(), 5u);
    EXPECT_EQ(request.at().revision(), 6u);
    response.add_samples()->set_state(v1::GroundSample::STATE_UNKNOWN);
    v1::GroundSample& free = *response.add_samples();
    free.set_state(v1::GroundSample::STATE_FREE);
    free.set_elevation_m(1.5f);
    free.set_slope_rad(0.25f);
    *response.mutable_version() = request.at();
    return grpc::Status::OK;
  };
  const auto heights =
      MapClient(server.Connect()).SampleHeights("yard", {{1, 2}, {3, -4}}, MapVersion{5, 6});
  ASSERT_TRUE(heights.ok()) << heights.status();
  EXPECT_EQ(heights->version, (MapVersion{5, 6}));
  EXPECT_EQ(heights->samples[0].state, GroundState::kUnknown);
  EXPECT_EQ(heights->samples[1].elevation_m, 1.5f);
  EXPECT_EQ(heights->samples[1].slope_rad, 0.25f);
}

TEST(MapClientTerrain, ChecksAPathOnTheNewestVersion) {
  FakeServer server;
  server.terrain.on_path = [](const auto& request, auto& response) {
    EXPECT_FALSE(request.has_at());
    EXPECT_EQ(request.path(1).x(), 9);
    EXPECT_EQ(request.footprint().rectangle().x_max(), 1.5);
    EXPECT_EQ(request.step_m(), 0.5);
    v1::PathSample& sample = *response.add_samples();
    sample.mutable_ground()->set_state(v1::GroundSample::STATE_FREE);
    sample.set_worst(v1::GroundSample::STATE_OBSTACLE);
    response.mutable_worst()->mutable_ground()->set_state(v1::GroundSample::STATE_OBSTACLE);
    response.set_free_distance_m(2.5);
    response.mutable_version()->set_revision(8);
    return grpc::Status::OK;
  };
  const auto path = MapClient(server.Connect())
                        .CheckPath("yard", {{{0, 0}, {9, 0}}, Rectangle{-1, -1, 1.5, 1}, 0.5});
  ASSERT_TRUE(path.ok()) << path.status();
  EXPECT_FALSE(path->check.free);
  EXPECT_EQ(path->check.free_distance_m, 2.5);
  EXPECT_EQ(path->check.samples[0].worst, GroundState::kObstacle);
  EXPECT_EQ(path->version.revision, 8u);
}

// A number of samples that is not that of the points would be read past its end.
TEST(MapClientTerrain, RefusesAnswersThatDoNotFitTheQuestion) {
  FakeServer server;
  server.terrain.on_heights = [](const auto&, auto& response) {
    response.add_samples()->set_state(v1::GroundSample::STATE_FREE);
    return grpc::Status::OK;
  };
  const auto heights = MapClient(server.Connect()).SampleHeights("yard", {{1, 2}, {3, 4}});
  EXPECT_THAT(std::string(heights.status().message()), HasSubstr("samples is 1 samples, want 2"));
}

TEST(MapClientTerrain, GivesTheServersRefusalOn) {
  FakeServer server;
  server.terrain.on_path = [](const auto&, auto&) -> grpc::Status {
    return {grpc::StatusCode::FAILED_PRECONDITION, "at is revision 3, which is not kept any more"};
  };
  const auto path = MapClient(server.Connect()).CheckPath("yard", {{{0, 0}}, Disc{1}, 0});
  EXPECT_TRUE(absl::IsFailedPrecondition(path.status())) << path.status();
}

}  // namespace
}  // namespace gem::client
