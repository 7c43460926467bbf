// Robots that send faster than their session can fuse, and would rather lose scans than time.
#include <gmock/gmock.h>

#include <condition_variable>
#include <mutex>

#include "server/metrics.h"
#include "server/registry.h"
#include "tests/server/test_server.h"

namespace gem {
namespace {

/// A stream that holds its session up in the middle of its work.
class SlowStream : public IngestSink {
 public:
  void OnProgress() override {
    std::unique_lock lock(mutex_);
    stalled_ = true;
    changed_.notify_all();
    changed_.wait(lock, [this] { return released_; });
  }
  void OnEnded(const absl::StatusOr<SessionEnd>& end) override {
    const std::lock_guard lock(mutex_);
    end_ = end;
    changed_.notify_all();
  }
  void OnTakenOver() override {}

  void WaitUntilStalled() {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [this] { return stalled_; });
  }
  void Release() {
    const std::lock_guard lock(mutex_);
    released_ = true;
    changed_.notify_all();
  }
  absl::StatusOr<SessionEnd> WaitForEnd() {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [this] { return end_.has_value(); });
    return *end_;
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  bool stalled_ = false;
  bool released_ = false;
  std::optional<absl::StatusOr<SessionEnd>> end_;
};

TEST(Overload, ASlowSessionFusesTheNewestScanNextAndLosesCountOfNothing) {
  ServerOptions options = TestOptions();
  Metrics metrics;
  Registry registry(options, /*epoch=*/1, metrics);
  const auto setup = wire::FromProto(TestOpen("r1", "s1"), wire::FieldPath("open"));
  ASSERT_TRUE(setup.ok());
  const auto session = *registry.OpenSession(*setup);
  const auto stream = std::make_shared<SlowStream>();
  ASSERT_TRUE(session->mailbox().Attach(stream, {0, 0, /*drop_oldest=*/true}).ok());

  // The first scan is fused; then the session is stuck. Nine more come, a second apart.
  const Clock::time_point start = Clock::now() - std::chrono::seconds(10);
  std::uint64_t sent_bytes = 0;
  const auto send = [&](std::uint64_t seq) {
    const v1::Scan scan = FlatScan(seq, 0);
    IngestMessage message;
    message.scan = std::make_shared<const v1::Scan>(scan);
    message.seq = seq;
    message.credit_bytes = scan.points().size();
    message.size_bytes = scan.SpaceUsedLong();
    message.arrived = start + std::chrono::seconds(seq);
    sent_bytes += message.credit_bytes;
    EXPECT_TRUE(session->Enqueue(stream.get(), std::move(message)));
  };
  send(1);
  stream->WaitUntilStalled();
  for (std::uint64_t seq = 2; seq <= 10; ++seq) send(seq);
  const IngestProgress meanwhile = session->mailbox().TakeProgress(stream.get());
  EXPECT_EQ(meanwhile.credit_bytes, sent_bytes / 10 * 9);  // all but the newest are paid back
  EXPECT_EQ(meanwhile.accepted_seq, 10u);
  EXPECT_EQ(meanwhile.fused_seq, 9u);
  EXPECT_EQ(meanwhile.problems.size(), 8u);

  stream->Release();
  session->mailbox().RequestEnd(stream.get());
  const absl::StatusOr<SessionEnd> end = stream->WaitForEnd();
  ASSERT_TRUE(end.ok()) << end.status();
  EXPECT_EQ(end->num_scans_fused, 2u);
  EXPECT_EQ(end->num_scans_dropped, 8u);
  EXPECT_EQ(end->num_scans_refused, 0u);
  EXPECT_EQ(session->feed()->newest().map->seq, 10u);
  EXPECT_EQ(session->mailbox().load().queue_bytes, 0u);
}

TEST(Overload, ARobotIsToldWhatWasDroppedAndGetsItsCreditBack) {
  ServerOptions options = TestOptions();
  options.overload_age_s_max = 0;
  TestServer server(options);
  v1::OpenSession open = TestOpen("r1", "s1");
  open.set_overload(v1::OVERLOAD_POLICY_DROP_OLDEST);
  TestStream robot(server.ingest(), open);
  for (std::uint64_t seq = 1; seq <= 200; ++seq) ASSERT_TRUE(robot.Send(FlatScan(seq, 0)));
  ASSERT_TRUE(robot.ReadUntilFused(200));
  EXPECT_EQ(FetchLocalMap(server, "r1").seq, 200u);
  EXPECT_EQ(robot.credit_bytes(), 200u * 12'288u);
  for (const v1::ScanProblem& problem : robot.problems())
    EXPECT_EQ(problem.reason(), v1::PROBLEM_REASON_DROPPED);
  ASSERT_TRUE(robot.SendClose());
  ASSERT_TRUE(robot.ReadUntilClosed());
  EXPECT_EQ(robot.closed().num_scans_dropped(),
            robot.problems().size() + robot.problems_left_out());
  EXPECT_EQ(robot.closed().num_scans_fused() + robot.closed().num_scans_dropped(), 200u);
  EXPECT_EQ(robot.closed().num_scans_refused(), 0u);
  EXPECT_EQ(server.Metric("gem_scans_total{reason=\"overload\",result=\"dropped\"}"),
            static_cast<double>(robot.closed().num_scans_dropped()));
}

TEST(Overload, APolicyThatDoesNotExistIsNamed) {
  TestServer server;
  v1::OpenSession open = TestOpen("r1", "s1");
  open.set_overload(static_cast<v1::OverloadPolicy>(7));
  const grpc::Status status = TestStream(server.ingest(), open).Finish();
  EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(status.error_message(), "open.overload is 7, want BLOCK or DROP_OLDEST");
}

}  // namespace
}  // namespace gem
