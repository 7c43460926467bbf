// Scans that wait for streamed poses: bounded, in order, and never in the way of the poses.
#include <gmock/gmock.h>

#include <algorithm>

#include "tests/server/test_server.h"

namespace gem {
namespace {

using testing::HasSubstr;
using testing::IsEmpty;

constexpr char kFused[] = "gem_scans_total{reason=\"\",result=\"fused\"}";

/// Longer than any test: what ends the wait is not the clock.
ServerOptions PatientOptions() {
  ServerOptions options = TestOptions();
  options.pose_wait_s_max = 10;
  return options;
}

/// At StampOf(seq) = seq times 0.1 s.
v1::Scan ScanWithoutPose(std::uint64_t seq) {
  v1::Scan scan = FlatScan(seq, 0);
  scan.clear_odom_from_base();
  return scan;
}

/// All points of the flat scan, each measured offset_s after the stamp.
v1::Scan ScanWithOffsets(std::uint64_t seq, float offset_s) {
  v1::Scan scan = FlatScan(seq, 0);
  wire::DecodedScan decoded;
  EXPECT_TRUE(wire::FromProto(scan, {}, wire::FieldPath("scan"), decoded).ok());
  wire::PointsToProto(decoded.points, &scan, std::vector<float>(decoded.points.size(), offset_s));
  return scan;
}

TEST(WaitingScan, WaitsForThePoseAfterIt) {
  TestServer server(PatientOptions());
  TestStream robot(server.ingest(), TestOpen("r1", "s1"));
  ASSERT_TRUE(robot.Send(PosesAt({0.05})));
  ASSERT_TRUE(robot.Send(ScanWithoutPose(1)));
  ASSERT_TRUE(robot.Send(PosesAt({0.15})));
  ASSERT_TRUE(robot.ReadUntilFused(1));
  EXPECT_THAT(robot.problems(), IsEmpty());
}

TEST(WaitingScan, WaitsForTheFirstPose) {
  // What the user saw: odometry starts a moment after the LiDAR, and the first scans were refused.
  TestServer server(PatientOptions());
  TestStream robot(server.ingest(), TestOpen("r1", "s1"));
  ASSERT_TRUE(robot.Send(ScanWithoutPose(1)));
  ASSERT_TRUE(robot.Send(PosesAt({0.05})));
  ASSERT_TRUE(robot.Send(PosesAt({0.15})));
  ASSERT_TRUE(robot.ReadUntilFused(1));
  EXPECT_THAT(robot.problems(), IsEmpty());
}

TEST(WaitingScan, IsRefusedAtOnceIfThePosesBeginAfterIt) {
  TestServer server(PatientOptions());
  TestStream robot(server.ingest(), TestOpen("r1", "s1"));
  ASSERT_TRUE(robot.Send(PosesAt({0.15})));
  ASSERT_TRUE(robot.Send(ScanWithoutPose(1)));
  ASSERT_TRUE(robot.ReadUntilProblems(1));
  EXPECT_EQ(robot.problems()[0].reason(), v1::PROBLEM_REASON_NO_POSE);
  EXPECT_EQ(robot.problems()[0].message(),
            "scan.odom_from_base is unset, want a transform, or streamed poses around the stamp "
            "100000000, which span 150000000 to 150000000; poses so old do not come any more");
}

TEST(WaitingScan, IsFusedInItsTurn) {
  TestServer server(PatientOptions());
  TestStream robot(server.ingest(), TestOpen("r1", "s1"));
  for (const std::uint64_t seq : {1, 2}) ASSERT_TRUE(robot.Send(ScanWithoutPose(seq)));
  ASSERT_TRUE(robot.Send(FlatScan(3, 0)));  // with its pose: waits for its turn
  for (const std::uint64_t seq : {4, 5}) ASSERT_TRUE(robot.Send(ScanWithoutPose(seq)));
  v1::Scan bad = FlatScan(6, 0);
  bad.set_sensor("unknown");
  ASSERT_TRUE(robot.Send(bad));
  ASSERT_TRUE(robot.Send(ScanWithoutPose(2)));  // a duplicate
  ASSERT_TRUE(robot.Send(PosesAt({0.05, 0.25})));
  ASSERT_TRUE(robot.ReadUntilFused(3));
  EXPECT_EQ(robot.fused_seq(), 3u);
  EXPECT_THAT(robot.problems(), IsEmpty());  // the bad one is told when its turn comes
  ASSERT_TRUE(robot.Send(PosesAt({0.55})));
  ASSERT_TRUE(robot.ReadUntilFused(6));
  ASSERT_EQ(robot.problems().size(), 1u);
  EXPECT_EQ(robot.problems()[0].seq(), 6u);
  ASSERT_TRUE(robot.SendClose());
  ASSERT_TRUE(robot.ReadUntilClosed());
  EXPECT_EQ(robot.closed().num_scans_fused(), 5u);
  EXPECT_EQ(robot.credit_bytes(), 7u * 12'288u);
  EXPECT_EQ(server.Metric("gem_queue_bytes"), 0);
}

TEST(WaitingScan, IsRefusedWithItsReasonWhenTheTimeIsUp) {
  ServerOptions options = TestOptions();
  options.pose_wait_s_max = 0.05;
  TestServer server(options);
  TestStream robot(server.ingest(), TestOpen("r1", "s1"));
  ASSERT_TRUE(robot.Send(PosesAt({0.01, 0.05})));
  ASSERT_TRUE(robot.Send(ScanWithoutPose(1)));
  ASSERT_TRUE(robot.ReadUntilFused(1));
  ASSERT_EQ(robot.problems().size(), 1u);
  EXPECT_EQ(robot.problems()[0].reason(), v1::PROBLEM_REASON_NO_POSE);
  EXPECT_THAT(robot.problems()[0].message(),
              testing::MatchesRegex(
                  "scan.odom_from_base is unset, want a transform, or streamed poses around the "
                  "stamp 100000000, which span 10000000 to 50000000; waited 0.* s, at most 0.05"));
  // The session goes on.
  ASSERT_TRUE(robot.Send(PosesAt({0.3})));
  ASSERT_TRUE(robot.Send(ScanWithoutPose(2)));
  ASSERT_TRUE(robot.ReadUntilFused(2));
  EXPECT_EQ(robot.problems().size(), 1u);
}

TEST(WaitingScan, OnlySoManyWaitAndTheOldestGoesFirst) {
  ServerOptions options = PatientOptions();
  options.waiting_scans_max = 2;
  TestServer server(options);
  TestStream robot(server.ingest(), TestOpen("r1", "s1"));
  for (const std::uint64_t seq : {1, 2, 3}) ASSERT_TRUE(robot.Send(ScanWithoutPose(seq)));
  ASSERT_TRUE(robot.ReadUntilProblems(1));
  EXPECT_EQ(robot.problems()[0].seq(), 1u);
  EXPECT_THAT(robot.problems()[0].message(), HasSubstr("; 3 scans wait, at most 2 may, waited 0."));
  ASSERT_TRUE(robot.Send(PosesAt({0, 1})));
  ASSERT_TRUE(robot.ReadUntilFused(3));
  EXPECT_EQ(robot.problems().size(), 1u);
  EXPECT_EQ(server.Metric(kFused), 2);
}

TEST(WaitingScan, TheQueueNeverKeepsPosesOut) {
  // Far more scans than the queue holds, from a robot that ignores its credit; then the poses.
  ServerOptions options = PatientOptions();
  options.scan_bytes_max = 20'000;
  options.queue_bytes_max = 80'000;
  TestServer server(options);
  TestStream robot(server.ingest(), TestOpen("r1", "s1"));
  for (std::uint64_t seq = 1; seq <= 30; ++seq) ASSERT_TRUE(robot.Send(ScanWithoutPose(seq)));
  ASSERT_TRUE(robot.Send(PosesAt({0, 10})));
  ASSERT_TRUE(robot.ReadUntilFused(30));
  ASSERT_FALSE(robot.problems().empty());
  EXPECT_EQ(robot.problems()[0].seq(), 1u);
  EXPECT_THAT(robot.problems()[0].message(),
              HasSubstr("bytes of scans wait, at most 40000 may, waited"));
  EXPECT_GE(server.Metric(kFused), 2);  // two scans of 16,384 bytes fit half of the queue
  EXPECT_EQ(robot.credit_bytes(), 30u * 12'288u);
  EXPECT_EQ(server.Metric("gem_queue_bytes"), 0);
}

TEST(WaitingScan, AScanAsLargeAsTheQueueLetsPosesThrough) {
  ServerOptions options = PatientOptions();
  options.scan_bytes_max = options.queue_bytes_max = 12'288;
  TestServer server(options);
  TestStream robot(server.ingest(), TestOpen("r1", "s1"));
  ASSERT_TRUE(robot.Send(ScanWithoutPose(1)));
  ASSERT_TRUE(robot.Send(PosesAt({0, 1})));
  ASSERT_TRUE(robot.ReadUntilFused(1));
  EXPECT_THAT(robot.problems(), IsEmpty());
}

TEST(WaitingScan, IsRefusedWhenTheSessionIsClosed) {
  TestServer server(PatientOptions());
  TestStream robot(server.ingest(), TestOpen("r1", "s1"));
  ASSERT_TRUE(robot.Send(FlatScan(1, 0)));
  ASSERT_TRUE(robot.Send(ScanWithoutPose(2)));
  ASSERT_TRUE(robot.Send(ScanWithoutPose(3)));
  ASSERT_TRUE(robot.SendClose());
  ASSERT_TRUE(robot.ReadUntilClosed());
  EXPECT_EQ(robot.closed().num_scans_fused(), 1u);
  EXPECT_EQ(robot.closed().num_scans_refused(), 2u);
  ASSERT_EQ(robot.problems().size(), 2u);
  EXPECT_THAT(robot.problems()[0].message(), HasSubstr("; the session ends, waited 0."));
}

TEST(WaitingScan, IsToldOfOnAStreamThatIsHalfClosed) {
  ServerOptions options = TestOptions();
  options.pose_wait_s_max = 0.05;
  TestServer server(options);
  TestStream robot(server.ingest(), TestOpen("r1", "s1"));
  ASSERT_TRUE(robot.Send(ScanWithoutPose(1)));
  robot.HalfClose();
  EXPECT_TRUE(robot.Finish().ok());
  EXPECT_EQ(robot.problems().size(), 1u);
  EXPECT_EQ(robot.fused_seq(), 1u);
}

TEST(WaitingScan, SurvivesItsStream) {
  TestServer server(PatientOptions());
  {
    TestStream robot(server.ingest(), TestOpen("r1", "s1"));
    ASSERT_TRUE(robot.Send(FlatScan(1, 0)));
    ASSERT_TRUE(robot.Send(ScanWithoutPose(2)));
    ASSERT_TRUE(robot.SendEmpty());  // refused, which tells that what came before has arrived
    ASSERT_TRUE(robot.ReadUntilProblems(1));
    ASSERT_TRUE(robot.ReadUntilFused(1));
    EXPECT_EQ(robot.accepted_seq(), 2u);
    robot.Vanish();
  }
  TestStream robot(server.ingest(), TestOpen("r1", "s1"));
  EXPECT_EQ(robot.opened().resume_after_seq(), 2u);
  EXPECT_EQ(robot.opened().credit_bytes(), (64u << 20) - 12'288u);  // it holds its credit
  ASSERT_TRUE(robot.Send(PosesAt({0.15, 0.25})));
  ASSERT_TRUE(robot.ReadUntilFused(2));
  EXPECT_THAT(robot.problems(), IsEmpty());
}

TEST(WaitingScan, DoesNotKeepASessionFromEndingByItself) {
  ServerOptions options = PatientOptions();
  options.session_idle_s_max = 0.05;
  TestServer server(options);
  {
    TestStream robot(server.ingest(), TestOpen("r1", "s1"));
    ASSERT_TRUE(robot.Send(ScanWithoutPose(1)));
    ASSERT_TRUE(robot.SendEmpty());  // refused, which tells that what came before has arrived
    ASSERT_TRUE(robot.ReadUntilProblems(1));
    robot.Vanish();
  }
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(30);
  while (server.Metric("gem_scans_total{reason=\"no_pose\",result=\"refused\"}") != 1 ||
         server.Metric("gem_sessions{state=\"alone\"}") != 0)
    ASSERT_LT(std::chrono::steady_clock::now(), deadline);
}

TEST(Poses, MayBeRepeated) {
  TestServer server;
  TestStream robot(server.ingest(), TestOpen("r1", "s1"));
  ASSERT_TRUE(robot.Send(PosesAt({0.1, 0.2})));
  ASSERT_TRUE(robot.Send(PosesAt({0.3, 0.4})));
  ASSERT_TRUE(robot.Send(PosesAt({0.1, 0.2})));  // as after a resume
  ASSERT_TRUE(robot.Send(PosesAt({0.3, 0.4, 0.5})));
  ASSERT_TRUE(robot.Send(FlatScan(1, 0)));
  ASSERT_TRUE(robot.ReadUntilFused(1));
  EXPECT_THAT(robot.problems(), IsEmpty());
  EXPECT_EQ(server.Metric("gem_pose_batches_total{result=\"accepted\"}"), 4);
  // Another pose between them is no repetition.
  ASSERT_TRUE(robot.Send(PosesAt({0.1, 0.35})));
  ASSERT_TRUE(robot.ReadUntilProblems(1));
  EXPECT_EQ(robot.problems()[0].reason(), v1::PROBLEM_REASON_OUT_OF_ORDER);
  EXPECT_EQ(robot.problems()[0].message(),
            "poses.poses[1].stamp_ns is 350000000, want more than the newest pose's, 500000000");
}

std::size_t NumKnownCells(const wire::DecodedLocalMap& map) {
  const GridLayer& heights = *map.grid.Find(Layer::kElevation);
  return static_cast<std::size_t>(std::count(heights.valid.begin(), heights.valid.end(), 1));
}

constexpr char kDeskewed[] = "gem_deskewed_scans_total{result=\"deskewed\"}";
constexpr char kAsItComes[] = "gem_deskewed_scans_total{result=\"as_it_comes\"}";

TEST(TimeOffsets, WaitForPosesOverTheWholeSpanAndAreUsed) {
  for (const bool has_pose : {true, false}) {
    TestServer server(PatientOptions());
    TestStream robot(server.ingest(), TestOpen("r1", "s1"));
    v1::Scan scan = ScanWithOffsets(1, 0.1f);  // at 0.1 s, points at 0.2 s
    scan.mutable_odom_from_base()->set_x(1);
    if (!has_pose) scan.clear_odom_from_base();
    ASSERT_TRUE(robot.Send(PosesAt({0, 0.1}, 10)));
    ASSERT_TRUE(robot.Send(scan));
    ASSERT_TRUE(robot.Send(PosesAt({0.15}, 10)));
    ASSERT_TRUE(robot.SendEmpty());
    ASSERT_TRUE(robot.ReadUntilProblems(1));
    ASSERT_TRUE(robot.Send(PosesAt({0.2}, 10)));
    ASSERT_TRUE(robot.ReadUntilFused(1));
    EXPECT_EQ(robot.problems().size(), 1u);
    EXPECT_EQ(server.Metric(kDeskewed), 1);
    const wire::DecodedLocalMap map = FetchLocalMap(server, "r1");
    EXPECT_NEAR(map.T_O_B.translation().x(), 1, 1e-9);
    // The points lie 1 m farther than they would without: two columns of cells see nothing.
    EXPECT_EQ(NumKnownCells(map), 14u * 16u);
  }
}

TEST(TimeOffsets, OfARobotThatStreamsNoPosesAreCountedAndNotUsed) {
  TestServer server(PatientOptions());
  TestStream robot(server.ingest(), TestOpen("r1", "s1"));
  ASSERT_TRUE(robot.Send(ScanWithOffsets(1, 0.1f)));
  ASSERT_TRUE(robot.ReadUntilFused(1));
  EXPECT_THAT(robot.problems(), IsEmpty());
  EXPECT_EQ(NumKnownCells(FetchLocalMap(server, "r1")), 256u);
  EXPECT_EQ(server.Metric(kAsItComes), 1);
  ASSERT_TRUE(robot.SendClose());
  ASSERT_TRUE(robot.ReadUntilClosed());
  EXPECT_EQ(robot.closed().num_scans_not_deskewed(), 1u);
}

TEST(TimeOffsets, BeyondTheLastPoseWaitOnlySoLong) {
  ServerOptions options = TestOptions();
  options.pose_wait_s_max = 0.05;
  TestServer server(options);
  TestStream robot(server.ingest(), TestOpen("r1", "s1"));
  ASSERT_TRUE(robot.Send(PosesAt({0, 0.15})));
  ASSERT_TRUE(robot.Send(ScanWithOffsets(1, 0.1f)));  // has a pose: fused as it comes
  v1::Scan scan = ScanWithOffsets(2, -0.1f);          // has none
  scan.clear_odom_from_base();
  ASSERT_TRUE(robot.Send(scan));
  ASSERT_TRUE(robot.ReadUntilFused(2));
  EXPECT_EQ(server.Metric(kAsItComes), 1);
  ASSERT_EQ(robot.problems().size(), 1u);
  EXPECT_EQ(robot.problems()[0].reason(), v1::PROBLEM_REASON_NO_POSE);
  EXPECT_THAT(robot.problems()[0].message(),
              HasSubstr("streamed poses from 100000000 to 200000000 around the stamp 200000000, "
                        "which span 0 to 150000000; waited 0."));
}

}  // namespace
}  // namespace gem
