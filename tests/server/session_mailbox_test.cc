#include "server/session_mailbox.h"

#include <gtest/gtest.h>

namespace gem {
namespace {

class Sink final : public IngestSink {
 public:
  void OnProgress() override {}
  void OnEnded(const absl::StatusOr<SessionEnd>&) override {}
  void OnTakenOver() override {}
};

/// The mailbox never looks into a scan: any pointer that is not null will do.
IngestMessage ScanOf(std::uint64_t seq, std::uint64_t bytes) {
  static const int kAnything = 0;
  IngestMessage message;
  message.scan = std::shared_ptr<const v1::Scan>(std::shared_ptr<const v1::Scan>(),
                                                 reinterpret_cast<const v1::Scan*>(&kAnything));
  message.seq = seq;
  message.credit_bytes = bytes;
  message.size_bytes = bytes + 10;  // what it occupies beyond its points
  return message;
}

Clock::time_point Now() { return Clock::now(); }

class SessionMailboxTest : public testing::Test {
 protected:
  SessionMailboxTest() { EXPECT_TRUE(mailbox_.Attach(sink_).ok()); }

  std::shared_ptr<Sink> sink_ = std::make_shared<Sink>();
  SessionMailbox mailbox_{1000};
};

TEST_F(SessionMailboxTest, StopsReadingWhenTheBytesReachTheLimit) {
  EXPECT_TRUE(mailbox_.Enqueue(sink_.get(), ScanOf(1, 489)));   // 499 bytes wait
  EXPECT_TRUE(mailbox_.Enqueue(sink_.get(), ScanOf(2, 490)));   // 999
  EXPECT_FALSE(mailbox_.Enqueue(sink_.get(), ScanOf(3, 100)));  // 1109
  EXPECT_FALSE(mailbox_.HasRoom());
  EXPECT_EQ(mailbox_.load().queue_bytes, 1109u);
  // A scan in hand still counts; one that is done does not.
  const SessionMailbox::Work work = mailbox_.Wait(Now());
  EXPECT_FALSE(mailbox_.HasRoom());
  mailbox_.FinishScan(*work.scan, 1, std::nullopt);
  EXPECT_TRUE(mailbox_.HasRoom());
  EXPECT_EQ(mailbox_.load().queue_bytes, 610u);
}

TEST_F(SessionMailboxTest, PaysBackTheCreditOfWhatIsDone) {
  mailbox_.Enqueue(sink_.get(), ScanOf(1, 100));
  mailbox_.Enqueue(sink_.get(), ScanOf(2, 200));
  EXPECT_FALSE(mailbox_.TakeProgress(sink_.get()).news);
  for (std::uint64_t seq = 1; seq <= 2; ++seq)
    mailbox_.FinishScan(*mailbox_.Wait(Now()).scan, seq, std::nullopt);
  const IngestProgress progress = mailbox_.TakeProgress(sink_.get());
  EXPECT_TRUE(progress.news);
  EXPECT_EQ(progress.credit_bytes, 300u);
  EXPECT_EQ(progress.fused_seq, 2u);
  EXPECT_EQ(progress.accepted_seq, 2u);
  EXPECT_FALSE(mailbox_.TakeProgress(sink_.get()).news);
}

TEST_F(SessionMailboxTest, AcceptsOnlyWhatIsNextInLine) {
  mailbox_.Enqueue(sink_.get(), ScanOf(1, 1));
  mailbox_.Enqueue(sink_.get(), ScanOf(3, 1));  // a gap: it will be refused
  mailbox_.Enqueue(sink_.get(), ScanOf(2, 1));
  EXPECT_EQ(mailbox_.TakeProgress(sink_.get()).accepted_seq, 2u);
}

TEST_F(SessionMailboxTest, ANewStreamGetsTheCreditThatIsLeft) {
  mailbox_.Enqueue(sink_.get(), ScanOf(1, 100));
  mailbox_.Enqueue(sink_.get(), ScanOf(2, 150));
  const auto next = std::make_shared<Sink>();
  const auto attached = mailbox_.Attach(next);
  ASSERT_TRUE(attached.ok());
  EXPECT_EQ(attached->resume_after_seq, 2u);
  EXPECT_EQ(attached->credit_bytes, 750u);
  EXPECT_EQ(attached->previous, sink_);
  // The old stream has no say any more.
  EXPECT_TRUE(mailbox_.Enqueue(sink_.get(), ScanOf(3, 100)));
  EXPECT_EQ(mailbox_.load().queue_bytes, 270u);
  mailbox_.Detach(sink_.get());
  EXPECT_TRUE(mailbox_.load().connected);
  // What the old stream sent is paid back to the new one.
  mailbox_.FinishScan(*mailbox_.Wait(Now()).scan, 1, std::nullopt);
  EXPECT_EQ(mailbox_.TakeProgress(next.get()).credit_bytes, 100u);
}

TEST_F(SessionMailboxTest, ListsSomeProblemsAndCountsTheRest) {
  for (std::uint64_t seq = 1; seq <= 40; ++seq) {
    mailbox_.Enqueue(sink_.get(), ScanOf(seq, 1));
    const SessionMailbox::Work work = mailbox_.Wait(Now());
    mailbox_.FinishScan(*work.scan, seq,
                        IngestProblem{seq, wire::ProblemReason::kMalformed, "why"});
  }
  const IngestProgress progress = mailbox_.TakeProgress(sink_.get());
  EXPECT_EQ(progress.problems.size(), 32u);
  EXPECT_EQ(progress.problems.front().seq, 1u);
  EXPECT_EQ(progress.problems_left_out, 8u);
}

TEST_F(SessionMailboxTest, TheEndComesAfterEverythingThatWaits) {
  mailbox_.Enqueue(sink_.get(), ScanOf(1, 1));
  mailbox_.RequestEnd(sink_.get());
  const SessionMailbox::Work first = mailbox_.Wait(Now());
  EXPECT_TRUE(first.scan.has_value());
  EXPECT_FALSE(first.end_requested);
  mailbox_.FinishScan(*first.scan, 1, std::nullopt);
  EXPECT_TRUE(mailbox_.Wait(Now()).end_requested);
  EXPECT_FALSE(mailbox_.Attach(std::make_shared<Sink>()).ok());
}

TEST_F(SessionMailboxTest, ScansInHandLeaveHalfOfTheQueueToPoses) {
  mailbox_.Enqueue(sink_.get(), ScanOf(1, 990));  // 1000 bytes: the queue is full
  EXPECT_FALSE(mailbox_.HasRoom());
  const SessionMailbox::Work work = mailbox_.Wait(Now());
  EXPECT_TRUE(mailbox_.HasRoom());
  IngestMessage poses;
  poses.size_bytes = 499;
  EXPECT_TRUE(mailbox_.Enqueue(sink_.get(), poses));
  EXPECT_FALSE(mailbox_.Enqueue(sink_.get(), poses));
  EXPECT_EQ(mailbox_.load().queue_bytes, 1998u);
  EXPECT_EQ(mailbox_.Wait(Now()).poses.size(), 2u);
  mailbox_.FinishPoses(poses, std::nullopt);
  EXPECT_TRUE(mailbox_.HasRoom());
  EXPECT_FALSE(mailbox_.idle());
  mailbox_.FinishPoses(poses, std::nullopt);
  mailbox_.FinishScan(*work.scan, 1, std::nullopt);
  EXPECT_TRUE(mailbox_.idle());
  EXPECT_EQ(mailbox_.load().queue_bytes, 0u);
}

TEST_F(SessionMailboxTest, SeveralScansMayBeInHand) {
  mailbox_.Enqueue(sink_.get(), ScanOf(1, 10));
  mailbox_.Enqueue(sink_.get(), ScanOf(2, 10));
  const SessionMailbox::Work first = mailbox_.Wait(Now());
  const SessionMailbox::Work second = mailbox_.Wait(Now());
  EXPECT_EQ(mailbox_.load().oldest, first.scan->arrived);
  mailbox_.FinishScan(*first.scan, 1, std::nullopt);
  EXPECT_EQ(mailbox_.load().oldest, second.scan->arrived);
  mailbox_.Detach(sink_.get());
  EXPECT_FALSE(mailbox_.CloseDoor(/*only_if_alone=*/true));
  mailbox_.FinishScan(*second.scan, 2, std::nullopt);
  EXPECT_EQ(mailbox_.load().oldest, std::nullopt);
  EXPECT_TRUE(mailbox_.CloseDoor(/*only_if_alone=*/true));
}

TEST_F(SessionMailboxTest, TellsTheEndToWhoeverComesBackForIt) {
  const auto late = std::make_shared<Sink>(), later = std::make_shared<Sink>();
  EXPECT_FALSE(mailbox_.AttachForEnd(late).ending);
  EXPECT_EQ(mailbox_.sink(), sink_);
  mailbox_.RequestEnd(sink_.get());
  const SessionMailbox::EndOutlook pending = mailbox_.AttachForEnd(late);
  EXPECT_TRUE(pending.ending);
  EXPECT_FALSE(pending.end.has_value());
  EXPECT_EQ(pending.previous, sink_);
  EXPECT_EQ(mailbox_.SetEnd(SessionEnd{{1, 2}, 3, 4, 5}), late);
  const SessionMailbox::EndOutlook known = mailbox_.AttachForEnd(later);
  EXPECT_TRUE(known.ending);
  ASSERT_TRUE(known.end.has_value());
  EXPECT_EQ((*known.end)->num_scans_fused, 3u);
}

TEST_F(SessionMailboxTest, TheDoorStaysOpenForARobotThatCameBack) {
  EXPECT_FALSE(mailbox_.CloseDoor(/*only_if_alone=*/true));
  mailbox_.Detach(sink_.get());
  EXPECT_TRUE(mailbox_.CloseDoor(/*only_if_alone=*/true));
  EXPECT_FALSE(mailbox_.Attach(sink_).ok());
}

TEST_F(SessionMailboxTest, WaitingEndsAtTheDeadlineAndWhenItStops) {
  EXPECT_FALSE(mailbox_.Wait(Now()).scan.has_value());
  mailbox_.Stop();
  EXPECT_TRUE(mailbox_.Wait(Now() + std::chrono::hours(1)).stopped);
}

}  // namespace
}  // namespace gem
