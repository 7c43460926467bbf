// TerrainService: what planners ask about the ground, over the wire.
#include <gmock/gmock.h>

#include <functional>
#include <limits>

#include "google/rpc/error_details.pb.h"
#include "tests/server/test_server.h"

namespace gem {
namespace {

/// A map "site" of free ground at z = 0: x from -4 to 6 m, y from -4 to 4 m, cells of 0.5 m.
class Terrain : public testing::Test {
 protected:
  Terrain() {
    TestStream robot(server_.ingest(), TestOpen("r1", "s1"));
    for (std::uint64_t seq = 1; seq <= 5; ++seq)
      EXPECT_TRUE(robot.Send(FlatScan(seq, 0.5 * static_cast<double>(seq - 1))));
    EXPECT_TRUE(robot.SendClose());
    EXPECT_TRUE(robot.ReadUntilClosed());
    version_ = robot.closed().version();
  }

  /// From (-3, 0) along x, a robot of 1 m.
  static v1::CheckPathRequest PathTo(double x_m) {
    v1::CheckPathRequest request;
    request.set_map("site");
    request.add_path()->set_x(-3);
    request.add_path()->set_x(x_m);
    request.mutable_footprint()->set_radius_m(0.5);
    return request;
  }
  grpc::Status Check(const v1::CheckPathRequest& request, v1::CheckPathResponse& response) {
    return TestServer::Call(server_.terrain(), &v1::TerrainService::Stub::CheckPath, request,
                            response);
  }
  grpc::Status Sample(const v1::SampleHeightsRequest& request,
                      v1::SampleHeightsResponse& response) {
    return TestServer::Call(server_.terrain(), &v1::TerrainService::Stub::SampleHeights, request,
                            response);
  }

  TestServer server_;
  v1::MapVersion version_;
};

/// The field that google.rpc.BadRequest names.
std::string FieldOf(const grpc::Status& status) {
  google::rpc::Status details;
  EXPECT_TRUE(details.ParseFromString(status.error_details()));
  google::rpc::BadRequest bad_request;
  for (const auto& detail : details.details())
    if (detail.UnpackTo(&bad_request)) return bad_request.field_violations(0).field();
  return "";
}

TEST_F(Terrain, HeightsOfAllPointsAreOfOneVersion) {
  v1::SampleHeightsRequest request;
  request.set_map("site");
  request.add_points()->set_x(100);
  request.add_points()->set_x(-1.3);
  v1::SampleHeightsResponse response;
  ASSERT_TRUE(Sample(request, response).ok());
  ASSERT_EQ(response.samples_size(), 2);
  EXPECT_EQ(response.samples(0).state(), v1::GroundSample::STATE_UNKNOWN);
  EXPECT_FALSE(response.samples(0).has_slope_rad());
  EXPECT_EQ(response.samples(1).state(), v1::GroundSample::STATE_FREE);
  EXPECT_NEAR(response.samples(1).elevation_m(), 0, 1e-3);
  EXPECT_GT(response.samples(1).variance_m2(), 0);
  EXPECT_GT(response.samples(1).traversability(), 0.9f);
  EXPECT_NEAR(response.samples(1).slope_rad(), 0, 1e-2);
  EXPECT_EQ(response.version().epoch(), version_.epoch());
  EXPECT_EQ(response.version().revision(), version_.revision());
}

TEST_F(Terrain, APathOverKnownGroundIsFreeAndOneBeyondIsNot) {
  v1::CheckPathResponse response;
  ASSERT_TRUE(Check(PathTo(5), response).ok());
  EXPECT_TRUE(response.free());
  EXPECT_EQ(response.free_distance_m(), 8);
  EXPECT_EQ(response.samples_size(), 17);
  EXPECT_EQ(response.version().revision(), version_.revision());
  // The disc of 0.5 m about x = 5.5 m touches the cell that begins at 6 m.
  ASSERT_TRUE(Check(PathTo(7), response).ok());
  EXPECT_FALSE(response.free());
  EXPECT_EQ(response.free_distance_m(), 8);
  EXPECT_EQ(response.worst().ground().state(), v1::GroundSample::STATE_UNKNOWN);
  EXPECT_EQ(response.worst().sample(), 17u);
  EXPECT_EQ(response.worst().position().x(), 6.25);
  EXPECT_EQ(response.samples(16).worst(), v1::GroundSample::STATE_FREE);
  EXPECT_EQ(response.samples(17).worst(), v1::GroundSample::STATE_UNKNOWN);
  EXPECT_GT(response.samples(17).unknown_share(), 0);
}

TEST_F(Terrain, RefusalsNameTheField) {
  v1::CheckPathResponse response;
  v1::CheckPathRequest request = PathTo(std::numeric_limits<double>::quiet_NaN());
  grpc::Status status = Check(request, response);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(status.error_message(), "path[1].x is nan, want at most 1e+06 in magnitude");
  EXPECT_EQ(FieldOf(status), "path[1].x");
  // What only the map's cell size decides is named as well.
  request = PathTo(5);
  request.set_step_m(1e-9);
  status = Check(request, response);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(FieldOf(status), "step_m");
  request = PathTo(9990);
  request.mutable_footprint()->set_radius_m(10);
  status = Check(request, response);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT) << status.error_message();
  EXPECT_EQ(FieldOf(status), "path");
  v1::SampleHeightsRequest none;
  none.set_map("site");
  v1::SampleHeightsResponse heights;
  EXPECT_EQ(FieldOf(Sample(none, heights)), "points");
}

TEST_F(Terrain, UnknownMapsAreNamed) {
  v1::CheckPathRequest request = PathTo(5);
  request.set_map("nowhere");
  v1::CheckPathResponse response;
  const grpc::Status status = Check(request, response);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::NOT_FOUND);
  EXPECT_EQ(FieldOf(status), "map");
}

TEST_F(Terrain, AnswersOnTheVersionThatIsAsked) {
  // A second robot maps what lies before the first one's ground.
  TestStream robot(server_.ingest(), TestOpen("r2", "s2"));
  ASSERT_TRUE(robot.Send(FlatScan(1, 8)));
  ASSERT_TRUE(robot.SendClose());
  ASSERT_TRUE(robot.ReadUntilClosed());
  v1::CheckPathRequest request = PathTo(7);
  v1::CheckPathResponse response;
  ASSERT_TRUE(Check(request, response).ok());
  EXPECT_TRUE(response.free());
  EXPECT_EQ(response.version().revision(), robot.closed().version().revision());
  *request.mutable_at() = version_;
  ASSERT_TRUE(Check(request, response).ok());
  EXPECT_FALSE(response.free());
  EXPECT_EQ(response.version().revision(), version_.revision());
  request.mutable_at()->set_epoch(1);
  EXPECT_EQ(Check(request, response).error_code(), grpc::StatusCode::FAILED_PRECONDITION);
}

TEST_F(Terrain, CallsAreMeasured) {
  v1::CheckPathResponse response;
  ASSERT_TRUE(Check(PathTo(5), response).ok());
  EXPECT_EQ(server_.Metric("gem_rpc_total{code=\"OK\",method=\"CheckPath\"}"), 1);
  EXPECT_EQ(server_.Metric("gem_rpc_started_total{method=\"SampleHeights\"}"), 0);
}

}  // namespace
}  // namespace gem
