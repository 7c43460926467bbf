#include "client/load/robot_load.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/client/fake_server.h"
#include "tests/client/load/growing_source.h"

namespace gem::load {
namespace {

using client::Acknowledge;
using client::AnswerClose;
using client::AnswerOpen;
using client::ReadScan;
using client::ServerStream;

class RobotLoadTest : public testing::Test {
 protected:
  std::unique_ptr<RobotLoad> Open() {
    client::SessionSetup setup;
    setup.map = "yard";
    setup.robot = setup.session = "r";
    setup.sensors = tape_->sensors();
    connection_ = server_.Connect();
    return std::make_unique<RobotLoad>(*connection_, *tape_, setup);
  }

  static std::unique_ptr<const ScanTape> MakeTape() {
    GrowingSource source(4);
    return *ScanTape::Record(source, {}, 4);
  }

  const std::unique_ptr<const ScanTape> tape_ = MakeTape();
  client::FakeServer server_;
  std::shared_ptr<const client::Connection> connection_;
};

TEST_F(RobotLoadTest, SendsWhatIsDueWithinItsCreditAndCountsWhatBecameOfIt) {
  server_.ingest.on_ingest = [&](int, ServerStream& stream) {
    // Credit for the first two scans, of 12 and 24 bytes, but not for the third, of 36.
    AnswerOpen(stream, 0, /*credit_bytes=*/40);
    EXPECT_EQ(ReadScan(stream).seq(), 1u);
    EXPECT_EQ(ReadScan(stream).seq(), 2u);
    v1::IngestResponse refusal;
    refusal.mutable_ack()->set_accepted_seq(2);
    refusal.mutable_ack()->set_fused_seq(2);
    refusal.mutable_ack()->set_credit_bytes(36);
    refusal.mutable_ack()->add_problems()->set_seq(2);
    stream.Write(refusal);
    EXPECT_EQ(ReadScan(stream).seq(), 3u);
    Acknowledge(stream, 3, 3);
    return AnswerClose(stream, 1);
  };
  const auto robot = Open();
  ASSERT_TRUE(robot->WaitUntilOpened().ok());
  for (int i = 0; i < 3; ++i) robot->Due();
  ASSERT_TRUE(robot->Close().ok());
  const RobotReport report = robot->report();
  EXPECT_EQ(report.num_fused, 2u);
  EXPECT_EQ(report.num_refused, 1u);
  EXPECT_EQ(report.latencies_s.size(), 3u);
  EXPECT_EQ(robot->num_done(), 3u);
}

TEST_F(RobotLoadTest, SaysThatScansWereNeverAcknowledged) {
  server_.ingest.on_ingest = [&](int, ServerStream& stream) {
    AnswerOpen(stream, 0);
    ReadScan(stream);
    return AnswerClose(stream, 1);
  };
  const auto robot = Open();
  ASSERT_TRUE(robot->WaitUntilOpened().ok());
  robot->Due();
  EXPECT_EQ(robot->Close().message(), "1 scans were never acknowledged");
}

TEST_F(RobotLoadTest, HearsWhyItIsNotLetIn) {
  server_.ingest.on_ingest = [](int, ServerStream&) {
    return grpc::Status(grpc::StatusCode::RESOURCE_EXHAUSTED, "too many");
  };
  const auto robot = Open();
  EXPECT_EQ(robot->WaitUntilOpened().message(), "too many");
  // Whoever goes on all the same comes to no harm.
  robot->Due();
  EXPECT_FALSE(robot->Close().ok());
}

TEST_F(RobotLoadTest, MayGoAwayInTheMiddle) {
  server_.ingest.on_ingest = [](int, ServerStream& stream) {
    AnswerOpen(stream, 0);
    v1::IngestRequest request;
    while (stream.Read(&request)) {
    }
    return grpc::Status::OK;
  };
  const auto robot = Open();
  ASSERT_TRUE(robot->WaitUntilOpened().ok());
  robot->FloodUntil(Clock::now() + std::chrono::hours(1));
}

}  // namespace
}  // namespace gem::load
