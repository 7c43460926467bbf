// What robots get wrong: each refusal names the field, is counted, and costs nothing else. After
// each the next good scan is fused.
#include <gmock/gmock.h>

#include <limits>

#include "google/rpc/error_details.pb.h"
#include "tests/network/tcp_proxy.h"
#include "tests/server/test_server.h"

namespace gem {
namespace {

using testing::HasSubstr;

std::string Refused(const char* reason) {
  return std::string("gem_scans_total{reason=\"") + reason + "\",result=\"refused\"}";
}

/// Sends one bad scan between two good ones.
class BadScan : public testing::Test {
 protected:
  /// `bad` has sequence number 2 unless it says otherwise.
  void ExpectRefused(const v1::Scan& bad, v1::ProblemReason reason, const char* reason_label,
                     const testing::Matcher<std::string>& text) {
    TestServer server(options_);
    TestStream robot(server.ingest(), TestOpen("r1", "s1"));
    ASSERT_TRUE(robot.Send(FlatScan(1, 0)));
    ASSERT_TRUE(robot.ReadUntilFused(1));
    ASSERT_TRUE(robot.Send(bad));
    ASSERT_TRUE(robot.ReadUntilProblems(1));
    EXPECT_EQ(robot.problems()[0].seq(), bad.seq());
    const bool is_out_of_line = bad.seq() != 2;
    EXPECT_EQ(robot.problems()[0].expected_seq(), is_out_of_line ? 2u : 0u);
    EXPECT_EQ(robot.problems()[0].reason(), reason);
    EXPECT_THAT(robot.problems()[0].message(), text);
    const std::uint64_t next = robot.fused_seq() + 1;
    ASSERT_TRUE(robot.Send(FlatScan(next, 0)));
    ASSERT_TRUE(robot.ReadUntilFused(next));
    EXPECT_EQ(robot.problems().size(), 1u);
    EXPECT_EQ(server.Metric(Refused(reason_label)), 1);
    EXPECT_EQ(server.Metric("gem_scans_total{reason=\"\",result=\"fused\"}"), 2);
  }

  /// A good scan whose points are replaced.
  static v1::Scan WithPoints(const std::vector<ScanPoint>& points) {
    v1::Scan scan = FlatScan(2, 0);
    wire::PointsToProto(points, &scan);
    return scan;
  }

  ServerOptions options_ = TestOptions();
};

TEST_F(BadScan, Truncated) {
  v1::Scan scan = FlatScan(2, 0);
  scan.mutable_points()->resize(12'000);
  ExpectRefused(scan, v1::PROBLEM_REASON_MALFORMED, "malformed",
                "scan.points is 12000 bytes, want point_count * point_stride = 1024 * 12 = 12288");
}

TEST_F(BadScan, Oversized) {
  options_.scan_bytes_max = 12'288;
  options_.queue_bytes_max = 1 << 20;
  ExpectRefused(WithPoints(std::vector<ScanPoint>(1025, ScanPoint{1, 1, -1, 0})),
                v1::PROBLEM_REASON_TOO_LARGE, "too_large",
                "scan.points is 12300 bytes, want at most 12288");
}

TEST_F(BadScan, TooManyPoints) {
  options_.points_max = 1024;
  ExpectRefused(WithPoints(std::vector<ScanPoint>(1025, ScanPoint{1, 1, -1, 0})),
                v1::PROBLEM_REASON_TOO_LARGE, "too_large",
                "scan.point_count is 1025, want at most 1024");
}

TEST_F(BadScan, NotANumber) {
  std::vector<ScanPoint> points(20, ScanPoint{1, 1, -1, 0});
  points[17].x_m = std::numeric_limits<float>::quiet_NaN();
  ExpectRefused(WithPoints(points), v1::PROBLEM_REASON_MALFORMED, "malformed",
                "scan.points[17].x is nan, want a finite number");
}

TEST_F(BadScan, Infinite) {
  std::vector<ScanPoint> points(20, ScanPoint{1, 1, -1, 0});
  points[3].z_m = -std::numeric_limits<float>::infinity();
  ExpectRefused(WithPoints(points), v1::PROBLEM_REASON_MALFORMED, "malformed",
                "scan.points[3].z is -inf, want a finite number");
}

TEST_F(BadScan, WithoutPointsAndDepthImage) {
  v1::Scan scan;
  scan.set_seq(2);
  scan.set_sensor("top");
  ExpectRefused(scan, v1::PROBLEM_REASON_MALFORMED, "malformed",
                "scan.points is without a layout and depth_image is unset, want one of the two");
}

TEST_F(BadScan, WithPointsAndDepthImage) {
  v1::Scan scan = FlatScan(2, 0);
  scan.mutable_depth_image();
  ExpectRefused(scan, v1::PROBLEM_REASON_MALFORMED, "malformed",
                "scan.depth_image is set and points are, too, want one of the two");
}

TEST_F(BadScan, DepthImageWithoutDepths) {
  v1::Scan scan;
  scan.set_seq(2);
  scan.set_sensor("top");
  v1::DepthImage& image = *scan.mutable_depth_image();
  image.set_width(640);
  image.set_height(480);
  image.set_fx(500);
  image.set_fy(500);
  image.set_encoding(v1::DepthImage::ENCODING_UINT16);
  ExpectRefused(scan, v1::PROBLEM_REASON_MALFORMED, "malformed",
                "scan.depth_image.depth is 0 bytes, want width * height * 2 = 640 * 480 * 2 = "
                "614400");
}

TEST_F(BadScan, TimeOffsetOfTwoSeconds) {
  v1::Scan scan = FlatScan(2, 0);
  wire::PointsToProto(std::vector<ScanPoint>{{1, 1, -1, 0}}, &scan, std::vector<float>{2});
  ExpectRefused(scan, v1::PROBLEM_REASON_MALFORMED, "malformed",
                "scan.points[0].time_offset is 2, want at most 1 s in magnitude");
}

TEST_F(BadScan, WrongStride) {
  v1::Scan scan = FlatScan(2, 0);
  scan.set_point_stride(3);
  ExpectRefused(scan, v1::PROBLEM_REASON_MALFORMED, "malformed",
                "scan.point_stride is 3, want 6 to 256");
}

TEST_F(BadScan, UnknownSensor) {
  v1::Scan scan = FlatScan(2, 0);
  scan.set_sensor("bottom");
  ExpectRefused(scan, v1::PROBLEM_REASON_UNKNOWN_SENSOR, "unknown_sensor",
                "scan.sensor is \"bottom\", want a sensor that the session declared");
}

TEST_F(BadScan, WithoutPose) {
  v1::Scan scan = FlatScan(2, 0);
  scan.clear_odom_from_base();
  options_.pose_wait_s_max = 0.01;
  ExpectRefused(scan, v1::PROBLEM_REASON_NO_POSE, "no_pose",
                testing::MatchesRegex(
                    "scan.odom_from_base is unset, want a transform, or streamed poses around the "
                    "stamp 200000000, of which there are none; waited .* s, at most 0.01"));
}

TEST_F(BadScan, WithAPoseOfNoLength) {
  v1::Scan scan = FlatScan(2, 0);
  scan.mutable_odom_from_base()->set_qw(0);
  ExpectRefused(
      scan, v1::PROBLEM_REASON_MALFORMED, "malformed",
      "scan.odom_from_base is a zero quaternion (qx = qy = qz = qw = 0), want a norm within "
      "0.01 of 1");
}

TEST_F(BadScan, AfterAGap) {
  ExpectRefused(FlatScan(5, 0), v1::PROBLEM_REASON_OUT_OF_ORDER, "out_of_order",
                "scan.seq is 5, want 2, the one after the last");
}

TEST_F(BadScan, NumberedZero) {
  v1::Scan scan = FlatScan(2, 0);
  scan.set_seq(0);
  ExpectRefused(scan, v1::PROBLEM_REASON_OUT_OF_ORDER, "out_of_order",
                "scan.seq is 0, want 2, the one after the last");
}

TEST_F(BadScan, FromThePast) {
  v1::Scan scan = FlatScan(2, 0);
  scan.set_stamp_ns(StampOf(1));
  ExpectRefused(scan, v1::PROBLEM_REASON_OUT_OF_ORDER, "out_of_order",
                "scan.stamp_ns is 100000000, want more than the scan's before it, 100000000");
}

TEST(BadInput, PosesThatDoNotIncreaseAreNamedAndCounted) {
  TestServer server;
  TestStream robot(server.ingest(), TestOpen("r1", "s1"));
  v1::PoseBatch poses;
  for (const std::int64_t stamp_ns : {5, 4}) {
    poses.add_poses()->set_stamp_ns(stamp_ns);
    poses.mutable_poses()->rbegin()->mutable_odom_from_base()->set_qw(1);
  }
  ASSERT_TRUE(robot.Send(poses));
  ASSERT_TRUE(robot.ReadUntilProblems(1));
  EXPECT_EQ(robot.problems()[0].seq(), 0u);
  EXPECT_EQ(robot.problems()[0].reason(), v1::PROBLEM_REASON_OUT_OF_ORDER);
  EXPECT_EQ(robot.problems()[0].message(),
            "poses.poses[1].stamp_ns is 4, want more than the stamp before it, 5");
  EXPECT_EQ(server.Metric("gem_pose_batches_total{result=\"refused\"}"), 1);
  ASSERT_TRUE(robot.Send(FlatScan(1, 0)));
  ASSERT_TRUE(robot.ReadUntilFused(1));
}

TEST(BadInput, PosesWithoutScansMakeNoMapAndEndWell) {
  TestServer server;
  TestStream robot(server.ingest(), TestOpen("r1", "s1"));
  v1::PoseBatch poses;
  poses.add_poses()->set_stamp_ns(5);
  poses.mutable_poses(0)->mutable_odom_from_base()->set_qw(1);
  ASSERT_TRUE(robot.Send(poses));
  ASSERT_TRUE(robot.SendClose());
  ASSERT_TRUE(robot.ReadUntilClosed());
  EXPECT_EQ(robot.closed().num_scans_fused(), 0u);
  EXPECT_EQ(server.Metric("gem_pose_batches_total{result=\"accepted\"}"), 1);
  EXPECT_TRUE(FetchMap(server, "site").Cells().empty());
}

TEST(BadInput, AnEmptyMessageIsAProblemAndNotTheEnd) {
  TestServer server;
  TestStream robot(server.ingest(), TestOpen("r1", "s1"));
  ASSERT_TRUE(robot.SendEmpty());
  ASSERT_TRUE(robot.ReadUntilProblems(1));
  EXPECT_EQ(robot.problems()[0].message(), "payload is unset, want scan, poses or close");
  ASSERT_TRUE(robot.Send(FlatScan(1, 0)));
  ASSERT_TRUE(robot.ReadUntilFused(1));
}

TEST(BadInput, TheFirstMessageMustOpen) {
  TestServer server;
  grpc::ClientContext context;
  context.set_deadline(TestDeadline());
  const auto stream = server.ingest().Ingest(&context);
  v1::IngestRequest request;
  *request.mutable_scan() = FlatScan(1, 0);
  stream->Write(request);
  v1::IngestResponse response;
  EXPECT_FALSE(stream->Read(&response));
  const grpc::Status status = stream->Finish();
  EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(status.error_message(), "open is unset, want it in the first message");
}

TEST(BadInput, AFloodOfProblemsIsListedInPartAndCountedInFull) {
  ServerOptions options = TestOptions();
  TestServer server(options);
  TestStream robot(server.ingest(), TestOpen("r1", "s1"));
  for (std::uint64_t seq = 1; seq <= 500; ++seq) {
    v1::Scan scan;
    scan.set_seq(seq);
    ASSERT_TRUE(robot.Send(scan));
  }
  ASSERT_TRUE(robot.ReadUntilFused(500));
  EXPECT_LE(robot.problems().size(), 500u);
  EXPECT_EQ(robot.problems().size() + robot.problems_left_out(), 500u);
  EXPECT_EQ(server.Metric(Refused("malformed")), 500);
}

TEST(BadInput, ErrorsOfCallsCarryTheFieldForPrograms) {
  TestServer server;
  TestStream robot(server.ingest(), TestOpen("r1", "s1"));
  v1::CorrectTrajectoryRequest request;
  request.set_map("site");
  request.set_session("s1");
  request.add_poses()->mutable_map_from_base()->set_x(std::numeric_limits<double>::quiet_NaN());
  v1::CorrectTrajectoryResponse response;
  const grpc::Status status = TestServer::Call(
      server.ingest(), &v1::IngestService::Stub::CorrectTrajectory, request, response);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(status.error_message(), "poses[0].map_from_base.x is nan, want a finite number");
  google::rpc::Status details;
  ASSERT_TRUE(details.ParseFromString(status.error_details()));
  ASSERT_EQ(details.details_size(), 1);
  google::rpc::BadRequest bad_request;
  ASSERT_TRUE(details.details(0).UnpackTo(&bad_request));
  EXPECT_EQ(bad_request.field_violations(0).field(), "poses[0].map_from_base.x");
  EXPECT_EQ(server.Metric("gem_rpc_total{code=\"INVALID_ARGUMENT\",method=\"CorrectTrajectory\"}"),
            1);
}

TEST(BadInput, ARobotThatVanishesInMidMessageLosesOnlyThatMessage) {
  TestServer server;
  // Another robot must not notice.
  TestStream other(server.ingest(), TestOpen("r2", "s2"));
  {
    // Scan 1 is 12 kB; scan 2 is 12 MB and cut after some 100 kB.
    test::TcpProxy proxy(server.address(), [](int) {
      return test::Fault{test::Fault::Kind::kCut, 120'000};
    });
    const auto channel = grpc::CreateChannel(proxy.address(), grpc::InsecureChannelCredentials());
    const auto stub = v1::IngestService::NewStub(channel);
    TestStream robot(*stub, TestOpen("r1", "s1"));
    ASSERT_TRUE(robot.Send(FlatScan(1, 0)));
    ASSERT_TRUE(robot.ReadUntilFused(1));
    v1::Scan huge = FlatScan(2, 0);
    wire::PointsToProto(std::vector<ScanPoint>(1'000'000, ScanPoint{1, 1, -1, 0}), &huge);
    robot.Send(huge);
    EXPECT_FALSE(robot.Finish().ok());
    EXPECT_EQ(proxy.bytes_passed(), 120'000u);
  }
  TestStream robot(server.ingest(), TestOpen("r1", "s1"));
  EXPECT_EQ(robot.opened().resume_after_seq(), 1u);
  ASSERT_TRUE(robot.Send(FlatScan(2, 0)));
  ASSERT_TRUE(robot.ReadUntilFused(2));
  EXPECT_TRUE(robot.problems().empty());
  ASSERT_TRUE(other.Send(FlatScan(1, 0)));
  ASSERT_TRUE(other.ReadUntilFused(1));
}

}  // namespace
}  // namespace gem
