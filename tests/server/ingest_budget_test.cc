// What sessions have in common: the bytes that wait for all of them. In turns, not in time.
#include "server/ingest_budget.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <deque>
#include <memory>
#include <vector>

#include "server/session_mailbox.h"

namespace gem {
namespace {

constexpr std::uint64_t kScan_bytes = 100;
constexpr std::uint64_t kQueue_bytes_max = 1000;

class Sink final : public IngestSink {
 public:
  void OnProgress() override {}
  void OnEnded(const absl::StatusOr<SessionEnd>&) override {}
  void OnTakenOver() override {}
};

/// A robot and its session, which fuses one scan a turn.
class Robot {
 public:
  explicit Robot(IngestBudget& budget)
      : mailbox_(kQueue_bytes_max, Clock::duration::max(), &budget) {
    credit_bytes_ = mailbox_.Attach(sink_)->credit_bytes;
  }

  /// Like a stream: not while the server does not read. Within the credit or not.
  bool Send() {
    if (!mailbox_.HasRoom()) return false;
    static const int kAnything = 0;
    IngestMessage message;
    message.scan = std::shared_ptr<const v1::Scan>(std::shared_ptr<const v1::Scan>(),
                                                   reinterpret_cast<const v1::Scan*>(&kAnything));
    message.seq = ++sent_seq_;
    message.credit_bytes = message.size_bytes = kScan_bytes;
    credit_bytes_ -= static_cast<std::int64_t>(kScan_bytes);
    mailbox_.Enqueue(sink_.get(), std::move(message));
    return true;
  }
  void Flood() {
    while (Send()) {
    }
  }
  void FuseOne() {
    if (!mailbox_.HasScans()) return;
    mailbox_.FinishScan(*mailbox_.Wait(Clock::now()).scan, std::nullopt);
    const IngestProgress progress = mailbox_.TakeProgress(sink_.get());
    credit_bytes_ += static_cast<std::int64_t>(progress.credit_bytes);
    fused_seq_ = progress.fused_seq;
  }

  std::int64_t credit_bytes() const { return credit_bytes_; }
  std::uint64_t sent_seq() const { return sent_seq_; }
  std::uint64_t fused_seq() const { return fused_seq_; }
  std::uint64_t waiting_bytes() const { return mailbox_.load().queue_bytes; }

 private:
  const std::shared_ptr<Sink> sink_ = std::make_shared<Sink>();
  SessionMailbox mailbox_;
  std::int64_t credit_bytes_ = 0;
  std::uint64_t sent_seq_ = 0;
  std::uint64_t fused_seq_ = 0;
};

TEST(IngestBudget, WhoFloodsGetsEqualPartsAndLeavesOneMore) {
  IngestBudget budget(/*bytes_max=*/1200, /*floor_bytes=*/kScan_bytes);
  Robot first(budget);
  first.Flood();
  EXPECT_EQ(first.waiting_bytes(), 600u);
  Robot second(budget);
  for (int turn = 0; turn < 10; ++turn)
    for (Robot* robot : {&first, &second}) {
      robot->FuseOne();
      robot->Flood();
    }
  EXPECT_EQ(first.waiting_bytes(), 400u);
  EXPECT_EQ(second.waiting_bytes(), 400u);
  EXPECT_EQ(budget.used_bytes(), 800u);
}

TEST(IngestBudget, NobodyGetsMoreThanItsQueueHolds) {
  IngestBudget budget(1'000'000, kScan_bytes);
  Robot robot(budget);
  EXPECT_EQ(robot.credit_bytes(), 1000);
  robot.Flood();
  EXPECT_EQ(robot.waiting_bytes(), 1000u);
}

TEST(IngestBudget, CreditShrinksWhileBytesAreScarceAndGrowsAgain) {
  IngestBudget budget(1200, kScan_bytes);
  Robot robot(budget);
  EXPECT_EQ(robot.credit_bytes(), 1000);
  for (int i = 0; i < 3; ++i) robot.Send();
  budget.Take(700);  // others; 200 are left of 1200, of which 300 are the robot's
  robot.FuseOne();   // 300 are left now, 200 of the robot wait, and it may send 700 more
  EXPECT_EQ(robot.credit_bytes(), 700);
  for (int i = 0; i < 7; ++i) {
    robot.Send();
    robot.FuseOne();
  }
  EXPECT_EQ(robot.waiting_bytes(), 200u);
  EXPECT_EQ(robot.credit_bytes(), 100);  // with what waits: 300
  budget.GiveBack(700);
  robot.FuseOne();
  EXPECT_EQ(robot.credit_bytes() + 100, 1000);
}

TEST(IngestBudget, WhoeverComesLateHasOneScansWorth) {
  IngestBudget budget(1200, kScan_bytes);
  budget.Take(5000);
  Robot late(budget);
  EXPECT_EQ(late.credit_bytes(), 100);
  for (std::uint64_t seq = 1; seq <= 20; ++seq) {
    ASSERT_GE(late.credit_bytes(), 100);
    ASSERT_TRUE(late.Send());
    late.FuseOne();
    ASSERT_EQ(late.fused_seq(), seq);
  }
}

// A polite robot waits for credit and sends one scan a turn; three others send all that is read,
// credit or not.
TEST(IngestBudget, APoliteRobotsScansAreFusedInTheTurnInWhichTheyCome) {
  constexpr std::uint64_t kBytes_max = 1200;
  IngestBudget budget(kBytes_max, kScan_bytes);
  std::deque<Robot> flooding;
  for (int i = 0; i < 3; ++i) flooding.emplace_back(budget);
  Robot polite(budget);
  for (std::uint64_t turn = 1; turn <= 500; ++turn) {
    for (Robot& robot : flooding) robot.Flood();
    ASSERT_GE(polite.credit_bytes(), static_cast<std::int64_t>(kScan_bytes));
    ASSERT_TRUE(polite.Send());
    // Each may go beyond what is left by the scan that it had begun to send.
    ASSERT_LE(budget.used_bytes(), kBytes_max + 4 * kScan_bytes);
    for (Robot& robot : flooding) robot.FuseOne();
    polite.FuseOne();
    ASSERT_EQ(polite.fused_seq(), turn);
  }
  for (const Robot& robot : flooding) EXPECT_EQ(robot.fused_seq(), 500u);
}

TEST(IngestBudget, GetsBackWhatWaitedForASessionThatIsGone) {
  IngestBudget budget(1200, kScan_bytes);
  {
    Robot robot(budget);
    robot.Flood();
    EXPECT_EQ(budget.used_bytes(), 600u);
  }
  EXPECT_EQ(budget.used_bytes(), 0u);
}

}  // namespace
}  // namespace gem
