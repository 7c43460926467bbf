// The life of a session: scans in, acknowledgements and credit back, resume, takeover, end.
#include <gmock/gmock.h>

#include <limits>

#include "tests/server/test_server.h"

namespace gem {
namespace {

TEST(Ingest, FusesScansAndTellsSo) {
  TestServer server;
  TestStream robot(server.ingest(), TestOpen("r1", "s1"));
  EXPECT_EQ(robot.opened().resume_after_seq(), 0u);
  EXPECT_EQ(robot.opened().scan_bytes_max(), 16u << 20);
  EXPECT_EQ(robot.opened().cell_size_m(), 0.5f);
  EXPECT_EQ(robot.opened().local_map_side_m(), 8.0f);
  for (std::uint64_t seq = 1; seq <= 5; ++seq) ASSERT_TRUE(robot.Send(FlatScan(seq, 0)));
  ASSERT_TRUE(robot.ReadUntilFused(5));
  EXPECT_EQ(robot.accepted_seq(), 5u);
  EXPECT_THAT(robot.problems(), testing::IsEmpty());
  EXPECT_EQ(server.Metric("gem_scans_total{reason=\"\",result=\"fused\"}"), 5);
}

TEST(Ingest, AFusedScanIsInTheLocalMap) {
  TestServer server;
  TestStream robot(server.ingest(), TestOpen("r1", "s1"));
  ASSERT_TRUE(robot.Send(FlatScan(1, 0)));
  ASSERT_TRUE(robot.ReadUntilFused(1));
  v1::GetLocalMapRequest request;
  request.set_robot("r1");
  v1::GetLocalMapResponse response;
  const grpc::Status status =
      TestServer::Call(server.tiles(), &v1::TileService::Stub::GetLocalMap, request, response);
  ASSERT_TRUE(status.ok()) << status.error_message();
  const auto map = wire::FromProto(response.local_map(), wire::FieldPath("local_map"));
  ASSERT_TRUE(map.ok()) << map.status();
  EXPECT_EQ(map->seq, 1u);
  EXPECT_EQ(map->stamp_ns, StampOf(1));
  EXPECT_EQ(map->session, "s1");
  EXPECT_EQ(map->grid.columns, 16);
  const GridLayer& heights = *map->grid.Find(Layer::kElevation);
  // All 256 cells see the ground, 1 m below the base.
  for (std::size_t i = 0; i < heights.values.size(); ++i) {
    ASSERT_EQ(heights.valid[i], 1) << i;
    ASSERT_NEAR(heights.values[i], 0, 0.01) << i;
  }
}

TEST(Ingest, GivesBackTheCreditOfEveryScan) {
  ServerOptions options = TestOptions();
  options.scan_bytes_max = 20'000;
  options.queue_bytes_max = 40'000;  // three scans of 1024 * 12 = 12,288 bytes
  TestServer server(options);
  TestStream robot(server.ingest(), TestOpen("r1", "s1"));
  EXPECT_EQ(robot.opened().credit_bytes(), 40'000u);
  std::uint64_t credit = robot.opened().credit_bytes(), given_back = 0;
  for (std::uint64_t seq = 1; seq <= 20; ++seq) {
    v1::Scan scan = FlatScan(seq, 0);
    if (seq % 5 == 0) scan.set_sensor("unknown");  // refused scans pay back too
    while (credit < scan.points().size()) {
      ASSERT_TRUE(robot.ReadUntilFused(robot.fused_seq() + 1));
      credit += robot.credit_bytes() - given_back;
      given_back = robot.credit_bytes();
    }
    credit -= scan.points().size();
    ASSERT_TRUE(robot.Send(scan));
  }
  ASSERT_TRUE(robot.ReadUntilFused(20));
  EXPECT_EQ(robot.credit_bytes(), 20u * 12'288u);
  EXPECT_EQ(robot.problems().size(), 4u);
  EXPECT_EQ(server.Metric("gem_queue_bytes"), 0);
}

TEST(Ingest, ARobotThatIgnoresItsCreditIsHeldBackAndLosesNothing) {
  ServerOptions options = TestOptions();
  options.scan_bytes_max = 20'000;
  options.queue_bytes_max = 20'000;  // one scan fills it
  TestServer server(options);
  TestStream robot(server.ingest(), TestOpen("r1", "s1"));
  for (std::uint64_t seq = 1; seq <= 50; ++seq) ASSERT_TRUE(robot.Send(FlatScan(seq, 0)));
  ASSERT_TRUE(robot.ReadUntilFused(50));
  EXPECT_THAT(robot.problems(), testing::IsEmpty());
  EXPECT_EQ(server.Metric("gem_scans_total{reason=\"\",result=\"fused\"}"), 50);
}

TEST(Ingest, TheEndSaysWhichVersionShowsEverything) {
  TestServer server;
  TestStream robot(server.ingest(), TestOpen("r1", "s1"));
  for (std::uint64_t seq = 1; seq <= 3; ++seq)
    ASSERT_TRUE(robot.Send(FlatScan(seq, static_cast<double>(seq))));
  v1::Scan bad = FlatScan(4, 4);
  bad.set_sensor("unknown");
  ASSERT_TRUE(robot.Send(bad));
  ASSERT_TRUE(robot.SendClose());
  ASSERT_TRUE(robot.ReadUntilClosed());
  EXPECT_EQ(robot.closed().num_scans_fused(), 3u);
  EXPECT_EQ(robot.closed().num_scans_refused(), 1u);
  EXPECT_EQ(robot.fused_seq(), 4u);  // acknowledged before the end is told
  EXPECT_TRUE(robot.Finish().ok());
  const TestMap map = FetchMap(server, "site");
  EXPECT_EQ(map.version.epoch, robot.closed().version().epoch());
  EXPECT_GE(map.version.revision, robot.closed().version().revision());
  // The window of 8 m moved by 2 m: 10 m x 8 m of cells of 0.5 m.
  EXPECT_EQ(map.Cells().size(), 20u * 16u);
}

TEST(Ingest, ASessionThatHasEndedCannotBeOpenedAgain) {
  TestServer server;
  {
    TestStream robot(server.ingest(), TestOpen("r1", "s1"));
    ASSERT_TRUE(robot.SendClose());
    ASSERT_TRUE(robot.ReadUntilClosed());
  }
  TestStream again(server.ingest(), TestOpen("r1", "s1"));
  const grpc::Status status = again.Finish();
  EXPECT_EQ(status.error_code(), grpc::StatusCode::FAILED_PRECONDITION);
  EXPECT_EQ(status.error_message(), "open.session is s1, which has ended, want a new id");
}

TEST(Ingest, WhoseCloseWasNotAnsweredHearsTheAnswerOnTheNextStream) {
  TestServer server;
  v1::SessionClosed first;
  {
    TestStream robot(server.ingest(), TestOpen("r1", "s1"));
    ASSERT_TRUE(robot.Send(FlatScan(1, 0)));
    ASSERT_TRUE(robot.SendClose());
    ASSERT_TRUE(robot.ReadUntilClosed());
    first = robot.closed();
  }
  v1::OpenSession open = TestOpen("r1", "s1");
  open.set_closing(true);
  for (int i = 0; i < 2; ++i) {
    TestStream again(server.ingest(), open);
    ASSERT_TRUE(again.ReadUntilClosed());
    EXPECT_EQ(again.closed().SerializeAsString(), first.SerializeAsString());
    EXPECT_TRUE(again.Finish().ok());
  }
  // It is nobody else's to hear.
  open.set_robot("r2");
  EXPECT_EQ(TestStream(server.ingest(), open).Finish().error_code(),
            grpc::StatusCode::FAILED_PRECONDITION);
}

TEST(Ingest, WhoseCloseWasLostIsOpenedAgainAndCloses) {
  TestServer server;
  {
    TestStream robot(server.ingest(), TestOpen("r1", "s1"));
    ASSERT_TRUE(robot.Send(FlatScan(1, 0)));
    ASSERT_TRUE(robot.ReadUntilFused(1));
    robot.Vanish();
  }
  v1::OpenSession open = TestOpen("r1", "s1");
  open.set_closing(true);
  TestStream again(server.ingest(), open);
  EXPECT_FALSE(again.has_closed());
  EXPECT_EQ(again.opened().resume_after_seq(), 1u);
  ASSERT_TRUE(again.SendClose());
  ASSERT_TRUE(again.ReadUntilClosed());
  EXPECT_EQ(again.closed().num_scans_fused(), 1u);
}

TEST(Ingest, NothingIsLostWhenTheStreamBreaksRightAfterClose) {
  // What the user saw: Close() failed with "has ended" although everything was in the map. However
  // far the server is when the stream breaks, the next one hears the end.
  TestServer server;
  for (int i = 0; i < 20; ++i) {
    v1::OpenSession open = TestOpen("r1", "s" + std::to_string(i));
    {
      TestStream robot(server.ingest(), open);
      ASSERT_TRUE(robot.Send(FlatScan(1, 0)));
      ASSERT_TRUE(robot.ReadUntilFused(1));
      ASSERT_TRUE(robot.SendClose());
      robot.Vanish();
    }
    open.set_closing(true);
    TestStream again(server.ingest(), open);
    if (!again.has_closed()) {
      ASSERT_TRUE(again.SendClose());
    }
    ASSERT_TRUE(again.ReadUntilClosed());
    EXPECT_EQ(again.closed().num_scans_fused(), 1u);
  }
}

TEST(Ingest, ADepthImageBecomesAMap) {
  TestServer server;
  v1::OpenSession open = TestOpen("r1", "s1");
  // Half a turn about x: a camera that looks straight down.
  open.mutable_sensors(0)->mutable_base_from_sensor()->set_qw(0);
  open.mutable_sensors(0)->mutable_base_from_sensor()->set_qx(1);
  open.mutable_sensors(0)->mutable_depth_camera();
  TestStream robot(server.ingest(), open);
  // 1 m to the ground everywhere; 40 pixels span 8 m of it.
  v1::Scan scan = FlatScan(1, 0);
  scan.clear_points();
  scan.clear_fields();
  scan.clear_point_count();
  scan.clear_point_stride();
  v1::DepthImage& image = *scan.mutable_depth_image();
  image.set_width(40);
  image.set_height(40);
  image.set_fx(5);
  image.set_fy(5);
  image.set_cx(19.5);
  image.set_cy(19.5);
  image.set_encoding(v1::DepthImage::ENCODING_FLOAT32);
  std::vector<float> depths(1600, 1.0f);
  depths[0] = std::numeric_limits<float>::quiet_NaN();
  image.set_depth(depths.data(), depths.size() * sizeof(float));
  std::string red;
  for (int i = 0; i < 1600; ++i) red += std::string("\xff\0\0", 3);
  image.set_rgb(red);
  ASSERT_TRUE(robot.Send(scan));
  ASSERT_TRUE(robot.ReadUntilFused(1));
  EXPECT_THAT(robot.problems(), testing::IsEmpty());
  EXPECT_EQ(robot.credit_bytes(), 1600u * 7);
  const wire::DecodedLocalMap map = FetchLocalMap(server, "r1");
  const GridLayer& heights = *map.grid.Find(Layer::kElevation);
  for (std::size_t i = 0; i < heights.values.size(); ++i) {
    ASSERT_EQ(heights.valid[i], 1) << i;
    ASSERT_NEAR(heights.values[i], 0, 0.01) << i;
  }
  EXPECT_EQ(server.Metric("gem_scan_points_total{outcome=\"fused\"}"), 1599);
}

TEST(Ingest, AParkedRobotAppearsInTheMapWithoutClosing) {
  TestServer server;
  TestStream robot(server.ingest(), TestOpen("r1", "s1"));
  ASSERT_TRUE(robot.Send(FlatScan(1, 0)));
  ASSERT_TRUE(robot.ReadUntilFused(1));
  // Published within one period; nothing else is sent.
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(30);
  std::size_t num_cells = 0;
  while (num_cells == 0 && std::chrono::steady_clock::now() < deadline)
    num_cells = FetchMap(server, "site").Cells().size();
  EXPECT_EQ(num_cells, 256u);
}

TEST(Ingest, AStreamThatIsHalfClosedHearsHowItsScansFared) {
  TestServer server;
  TestStream robot(server.ingest(), TestOpen("r1", "s1"));
  ASSERT_TRUE(robot.Send(FlatScan(1, 0)));
  ASSERT_TRUE(robot.Send(FlatScan(2, 0)));
  robot.HalfClose();
  EXPECT_TRUE(robot.Finish().ok());
  EXPECT_EQ(robot.fused_seq(), 2u);
}

TEST(Ingest, AVanishedRobotResumesWhereItWas) {
  TestServer server;
  {
    TestStream robot(server.ingest(), TestOpen("r1", "s1"));
    for (std::uint64_t seq = 1; seq <= 3; ++seq) ASSERT_TRUE(robot.Send(FlatScan(seq, 0)));
    ASSERT_TRUE(robot.ReadUntilFused(3));
    robot.Vanish();
  }
  TestStream robot(server.ingest(), TestOpen("r1", "s1"));
  EXPECT_EQ(robot.opened().resume_after_seq(), 3u);
  EXPECT_EQ(robot.opened().epoch(), FetchMap(server, "site").version.epoch);
  EXPECT_EQ(robot.opened().credit_bytes(), 64u << 20);
  ASSERT_TRUE(robot.Send(FlatScan(4, 0)));
  ASSERT_TRUE(robot.ReadUntilFused(4));
  EXPECT_THAT(robot.problems(), testing::IsEmpty());
}

TEST(Ingest, RepeatedScansAreAcknowledgedAndNotFusedTwice) {
  TestServer server;
  TestStream robot(server.ingest(), TestOpen("r1", "s1"));
  ASSERT_TRUE(robot.Send(FlatScan(1, 0)));
  ASSERT_TRUE(robot.Send(FlatScan(1, 0)));
  ASSERT_TRUE(robot.Send(FlatScan(2, 0)));
  ASSERT_TRUE(robot.ReadUntilFused(2));
  EXPECT_EQ(robot.credit_bytes(), 3u * 12'288u);
  EXPECT_THAT(robot.problems(), testing::IsEmpty());
  EXPECT_EQ(server.Metric("gem_scans_total{reason=\"\",result=\"fused\"}"), 2);
  EXPECT_EQ(server.Metric("gem_scans_total{reason=\"\",result=\"duplicate\"}"), 1);
}

TEST(Ingest, ASecondStreamTakesTheSessionOver) {
  TestServer server;
  TestStream first(server.ingest(), TestOpen("r1", "s1"));
  ASSERT_TRUE(first.Send(FlatScan(1, 0)));
  ASSERT_TRUE(first.ReadUntilFused(1));
  TestStream second(server.ingest(), TestOpen("r1", "s1"));
  EXPECT_EQ(second.opened().resume_after_seq(), 1u);
  const grpc::Status status = first.Finish();
  EXPECT_EQ(status.error_code(), grpc::StatusCode::ABORTED);
  EXPECT_EQ(status.error_message(), "another stream has resumed the session");
  ASSERT_TRUE(second.Send(FlatScan(2, 0)));
  ASSERT_TRUE(second.ReadUntilFused(2));
}

TEST(Ingest, WhatAStreamSaysAfterItWasTakenOverIsIgnored) {
  // A half-dead connection: the robot has come back on another one, and only then arrives what the
  // first one carried.
  TestServer server;
  TestStream first(server.ingest(), TestOpen("r1", "s1"));
  ASSERT_TRUE(first.Send(FlatScan(1, 0)));
  ASSERT_TRUE(first.ReadUntilFused(1));
  TestStream second(server.ingest(), TestOpen("r1", "s1"));
  for (std::uint64_t seq = 2; seq <= 5; ++seq) first.Send(FlatScan(seq, 100));
  EXPECT_EQ(first.Finish().error_code(), grpc::StatusCode::ABORTED);
  for (std::uint64_t seq = 2; seq <= 3; ++seq) ASSERT_TRUE(second.Send(FlatScan(seq, 0)));
  ASSERT_TRUE(second.ReadUntilFused(3));
  EXPECT_THAT(second.problems(), testing::IsEmpty());
  EXPECT_EQ(second.credit_bytes(), 2u * 12'288u);
  EXPECT_EQ(server.Metric("gem_scans_total{reason=\"\",result=\"fused\"}"), 3);
  EXPECT_EQ(FetchLocalMap(server, "r1").T_O_B.translation().x(), 0);
}

TEST(Ingest, AnOpeningThatWasOvertakenOnItsWayIsRefused) {
  TestServer server;
  v1::OpenSession open = TestOpen("r1", "s1");
  open.set_opener(7);
  open.set_attempt(2);
  TestStream stream(server.ingest(), open);
  open.set_attempt(1);
  const grpc::Status status = TestStream(server.ingest(), open).Finish();
  EXPECT_EQ(status.error_code(), grpc::StatusCode::ABORTED);
  EXPECT_EQ(status.error_message(),
            "open.attempt is 1, want more than 2: another stream has resumed the session");
  ASSERT_TRUE(stream.Send(FlatScan(1, 0)));
  ASSERT_TRUE(stream.ReadUntilFused(1));
}

TEST(Ingest, ASessionWithoutAStreamEndsByItself) {
  ServerOptions options = TestOptions();
  options.session_idle_s_max = 0.05;
  TestServer server(options);
  {
    TestStream robot(server.ingest(), TestOpen("r1", "s1"));
    ASSERT_TRUE(robot.Send(FlatScan(1, 0)));
    ASSERT_TRUE(robot.ReadUntilFused(1));
    robot.Vanish();
  }
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(30);
  while (server.Metric("gem_sessions{state=\"alone\"}") != 0 ||
         server.Metric("gem_sessions{state=\"connected\"}") != 0)
    ASSERT_LT(std::chrono::steady_clock::now(), deadline);
  // Its local map is still there for readers.
  v1::GetLocalMapRequest request;
  request.set_robot("r1");
  v1::GetLocalMapResponse response;
  EXPECT_TRUE(
      TestServer::Call(server.tiles(), &v1::TileService::Stub::GetLocalMap, request, response)
          .ok());
}

TEST(Ingest, FindsThePoseBetweenStreamedPoses) {
  TestServer server;
  TestStream robot(server.ingest(), TestOpen("r1", "s1"));
  ASSERT_TRUE(robot.Send(PosesAt({0, 0.2}, 10)));
  v1::Scan scan = FlatScan(1, 0);  // at 0.1 s
  scan.clear_odom_from_base();
  ASSERT_TRUE(robot.Send(scan));
  ASSERT_TRUE(robot.ReadUntilFused(1));
  ASSERT_THAT(robot.problems(), testing::IsEmpty());
  EXPECT_NEAR(FetchLocalMap(server, "r1").T_O_B.translation().x(), 1.0, 1e-9);  // from 0 to 2
}

TEST(Ingest, SetupsThatContradictTheMapNameTheFieldAndBothValues) {
  TestServer server;
  TestStream first(server.ingest(), TestOpen("r1", "s1"));
  v1::OpenSession open = TestOpen("r2", "s2");
  open.mutable_map_setup()->set_cell_size_m(0.1f);
  TestStream second(server.ingest(), open);
  const grpc::Status status = second.Finish();
  EXPECT_EQ(status.error_code(), grpc::StatusCode::FAILED_PRECONDITION);
  EXPECT_EQ(status.error_message(), "open.map_setup.cell_size_m is 0.1, want 0.5 as the map has");
}

TEST(Ingest, OptionsOutOfRangeAreNamedAsTheRobotKnowsThem) {
  TestServer server;
  v1::OpenSession open = TestOpen("r1", "s1");
  open.mutable_map_setup()->set_cell_size_m(100);
  grpc::Status status = TestStream(server.ingest(), open).Finish();
  EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_THAT(status.error_message(), testing::StartsWith("open.map_setup.cell_size_m is 100"));
  open = TestOpen("r1", "s1");
  open.mutable_local_map()->set_range_m_max(-1);
  status = TestStream(server.ingest(), open).Finish();
  EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_THAT(status.error_message(), testing::StartsWith("open.local_map.range_m"));
  // Neither left a map behind.
  v1::ListMapsResponse maps;
  ASSERT_TRUE(
      TestServer::Call(server.maps(), &v1::MapService::Stub::ListMaps, v1::ListMapsRequest(), maps)
          .ok());
  EXPECT_EQ(maps.maps_size(), 0);
}

TEST(Ingest, TheNumberOfSessionsAndMapsIsLimitedAndTheTextSaysSo) {
  ServerOptions options = TestOptions();
  options.sessions_max = 1;
  TestServer server(options);
  TestStream first(server.ingest(), TestOpen("r1", "s1"));
  const grpc::Status status = TestStream(server.ingest(), TestOpen("r2", "s2")).Finish();
  EXPECT_EQ(status.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_EQ(status.error_message(), "1 sessions are open, want at most 1");

  options = TestOptions();
  options.maps_max = 1;
  TestServer other(options);
  TestStream second(other.ingest(), TestOpen("r1", "s1"));
  v1::OpenSession elsewhere = TestOpen("r2", "s2");
  elsewhere.set_map("elsewhere");
  const grpc::Status full = TestStream(other.ingest(), elsewhere).Finish();
  EXPECT_EQ(full.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_EQ(full.error_message(), "there are 1 maps, want at most 1");
}

TEST(Ingest, ASessionBelongsToItsRobot) {
  TestServer server;
  TestStream first(server.ingest(), TestOpen("r1", "s1"));
  const grpc::Status status = TestStream(server.ingest(), TestOpen("r2", "s1")).Finish();
  EXPECT_EQ(status.error_code(), grpc::StatusCode::FAILED_PRECONDITION);
  EXPECT_EQ(status.error_message(), "open.robot is r2, want r1, whose session s1 is");
}

}  // namespace
}  // namespace gem
