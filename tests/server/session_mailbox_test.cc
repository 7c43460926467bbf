#include "server/session_mailbox.h"

#include <gtest/gtest.h>

#include <random>

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
  EXPECT_TRUE(mailbox_.Enqueue(sink_.get(), ScanOf(1, 489)).may_read_on);   // 499 bytes wait
  EXPECT_TRUE(mailbox_.Enqueue(sink_.get(), ScanOf(2, 490)).may_read_on);   // 999
  EXPECT_FALSE(mailbox_.Enqueue(sink_.get(), ScanOf(3, 100)).may_read_on);  // 1109
  EXPECT_FALSE(mailbox_.HasRoom());
  EXPECT_EQ(mailbox_.load().queue_bytes, 1109u);
  // A scan in hand still counts; one that is done does not.
  const SessionMailbox::Work work = mailbox_.Wait(Now());
  EXPECT_FALSE(mailbox_.HasRoom());
  mailbox_.FinishScan(*work.scan, std::nullopt);
  EXPECT_TRUE(mailbox_.HasRoom());
  EXPECT_EQ(mailbox_.load().queue_bytes, 610u);
}

TEST_F(SessionMailboxTest, PaysBackTheCreditOfWhatIsDone) {
  mailbox_.Enqueue(sink_.get(), ScanOf(1, 100));
  mailbox_.Enqueue(sink_.get(), ScanOf(2, 200));
  EXPECT_FALSE(mailbox_.TakeProgress(sink_.get()).news);
  for (std::uint64_t seq = 1; seq <= 2; ++seq)
    mailbox_.FinishScan(*mailbox_.Wait(Now()).scan, std::nullopt);
  const IngestProgress progress = mailbox_.TakeProgress(sink_.get());
  EXPECT_TRUE(progress.news);
  EXPECT_EQ(progress.credit_bytes, 300u);
  EXPECT_EQ(progress.fused_seq, 2u);
  EXPECT_EQ(progress.accepted_seq, 2u);
  EXPECT_FALSE(mailbox_.TakeProgress(sink_.get()).news);
}

TEST_F(SessionMailboxTest, AcceptsOnlyWhatIsNextInLine) {
  using Verdict = SessionMailbox::Verdict;
  EXPECT_EQ(mailbox_.Enqueue(sink_.get(), ScanOf(1, 1)).verdict, Verdict::kTaken);
  EXPECT_EQ(mailbox_.Enqueue(sink_.get(), ScanOf(3, 10)).verdict, Verdict::kOutOfLine);
  EXPECT_EQ(mailbox_.Enqueue(sink_.get(), ScanOf(2, 1)).verdict, Verdict::kTaken);
  EXPECT_EQ(mailbox_.Enqueue(sink_.get(), ScanOf(0, 100)).verdict, Verdict::kOutOfLine);
  EXPECT_EQ(mailbox_.load().queue_bytes, 22u);  // what is refused at the door does not wait
  const IngestProgress progress = mailbox_.TakeProgress(sink_.get());
  EXPECT_TRUE(progress.news);
  EXPECT_EQ(progress.accepted_seq, 2u);
  EXPECT_EQ(progress.fused_seq, 0u);
  EXPECT_EQ(progress.credit_bytes, 110u);
  ASSERT_EQ(progress.problems.size(), 2u);
  EXPECT_EQ(progress.problems[0].seq, 3u);
  EXPECT_EQ(progress.problems[0].expected_seq, 2u);
  EXPECT_EQ(progress.problems[0].text, "scan.seq is 3, want 2, the one after the last");
  EXPECT_EQ(progress.problems[1].seq, 0u);
  EXPECT_EQ(progress.problems[1].expected_seq, 3u);
}

TEST_F(SessionMailboxTest, AcknowledgesDuplicatesAgainWithoutAWord) {
  for (std::uint64_t seq = 1; seq <= 3; ++seq) mailbox_.Enqueue(sink_.get(), ScanOf(seq, 1));
  mailbox_.FinishScan(*mailbox_.Wait(Now()).scan, std::nullopt);
  mailbox_.TakeProgress(sink_.get());
  for (const std::uint64_t seq : {1, 2, 3})  // done, waiting, waiting
    EXPECT_EQ(mailbox_.Enqueue(sink_.get(), ScanOf(seq, 10)).verdict,
              SessionMailbox::Verdict::kDuplicate);
  const IngestProgress progress = mailbox_.TakeProgress(sink_.get());
  EXPECT_TRUE(progress.news);
  EXPECT_EQ(progress.accepted_seq, 3u);
  EXPECT_EQ(progress.fused_seq, 1u);
  EXPECT_EQ(progress.credit_bytes, 30u);
  EXPECT_TRUE(progress.problems.empty());
  EXPECT_EQ(mailbox_.load().queue_bytes, 22u);
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
  // The old stream has no say any more, and is not held up either.
  const SessionMailbox::Enqueued late = mailbox_.Enqueue(sink_.get(), ScanOf(3, 100));
  EXPECT_EQ(late.verdict, SessionMailbox::Verdict::kStranger);
  EXPECT_TRUE(late.may_read_on);
  EXPECT_EQ(mailbox_.load().queue_bytes, 270u);
  mailbox_.Detach(sink_.get());
  EXPECT_TRUE(mailbox_.load().connected);
  // What the old stream sent is paid back to the new one.
  mailbox_.FinishScan(*mailbox_.Wait(Now()).scan, std::nullopt);
  EXPECT_EQ(mailbox_.TakeProgress(next.get()).credit_bytes, 100u);
}

TEST_F(SessionMailboxTest, ALateOpeningOfTheSameProcessHasNoSay) {
  const auto early = std::make_shared<Sink>(), late = std::make_shared<Sink>();
  ASSERT_TRUE(mailbox_.Attach(early, {7, 2}).ok());
  EXPECT_TRUE(absl::IsAborted(mailbox_.Attach(late, {7, 1}).status()));
  EXPECT_TRUE(absl::IsAborted(mailbox_.Attach(late, {7, 2}).status()));
  EXPECT_EQ(mailbox_.sink(), early);
  // Also when the stream has gone, and when the session is ending.
  mailbox_.Detach(early.get());
  EXPECT_TRUE(absl::IsAborted(mailbox_.Attach(late, {7, 1}).status()));
  ASSERT_TRUE(mailbox_.Attach(early, {7, 3}).ok());
  mailbox_.RequestEnd(early.get());
  EXPECT_TRUE(absl::IsAborted(mailbox_.AttachForEnd(late, {7, 2}).status()));
  EXPECT_EQ(mailbox_.sink(), early);
  EXPECT_TRUE(mailbox_.AttachForEnd(late, {7, 4}).ok());
  EXPECT_EQ(mailbox_.sink(), late);
}

TEST_F(SessionMailboxTest, AnotherProcessTakesOverWhateverItsCount) {
  ASSERT_TRUE(mailbox_.Attach(sink_, {7, 9}).ok());
  EXPECT_TRUE(mailbox_.Attach(std::make_shared<Sink>(), {8, 1}).ok());
  EXPECT_TRUE(mailbox_.Attach(std::make_shared<Sink>()).ok());  // does not say
  EXPECT_TRUE(mailbox_.Attach(std::make_shared<Sink>()).ok());
}

class OverloadTest : public testing::Test {
 protected:
  static constexpr std::chrono::milliseconds kAge_max{200};

  void Attach(bool drop_oldest) { ASSERT_TRUE(mailbox_.Attach(sink_, {0, 0, drop_oldest}).ok()); }
  SessionMailbox::Enqueued Enqueue(std::uint64_t seq, int at_ms, std::uint64_t bytes = 90) {
    IngestMessage scan = ScanOf(seq, bytes);
    scan.arrived = start_ + std::chrono::milliseconds(at_ms);
    return mailbox_.Enqueue(sink_.get(), std::move(scan));
  }

  /// Long ago: for Wait(), which looks at the clock, everything is old.
  const Clock::time_point start_ = Now() - std::chrono::hours(1);
  std::shared_ptr<Sink> sink_ = std::make_shared<Sink>();
  SessionMailbox mailbox_{1000, kAge_max};
};

TEST_F(OverloadTest, WhatHasWaitedTooLongGivesWayToWhatComes) {
  Attach(/*drop_oldest=*/true);
  Enqueue(1, 0);
  Enqueue(2, 100);
  EXPECT_EQ(Enqueue(3, 200).num_dropped, 0u);  // the first has waited exactly so long
  EXPECT_EQ(Enqueue(4, 350).num_dropped, 2u);
  EXPECT_EQ(mailbox_.load().queue_bytes, 200u);
  const IngestProgress progress = mailbox_.TakeProgress(sink_.get());
  EXPECT_EQ(progress.credit_bytes, 180u);
  EXPECT_EQ(progress.accepted_seq, 4u);
  EXPECT_EQ(progress.fused_seq, 2u);
  ASSERT_EQ(progress.problems.size(), 2u);
  EXPECT_EQ(progress.problems[1].seq, 2u);
  EXPECT_EQ(progress.problems[1].reason, wire::ProblemReason::kDropped);
  EXPECT_EQ(progress.problems[1].text, "waited 0.25 s, and newer scans came");
  EXPECT_EQ(progress.problems[1].expected_seq, 0u);
}

TEST_F(OverloadTest, DroppedScansAreDoneOnlyWhenThoseBeforeThemAre) {
  Attach(/*drop_oldest=*/true);
  Enqueue(1, 0);
  const SessionMailbox::Work in_hand = mailbox_.Wait(Now());
  Enqueue(2, 10);
  Enqueue(3, 500);
  EXPECT_EQ(mailbox_.TakeProgress(sink_.get()).fused_seq, 0u);
  mailbox_.FinishScan(*in_hand.scan, std::nullopt);
  EXPECT_EQ(mailbox_.TakeProgress(sink_.get()).fused_seq, 2u);
  EXPECT_EQ(mailbox_.Wait(Now()).scan->seq, 3u);
}

TEST_F(OverloadTest, ASessionThatWasBusyFindsTheNewestScan) {
  Attach(/*drop_oldest=*/true);
  for (int i = 0; i < 5; ++i) Enqueue(static_cast<std::uint64_t>(i + 1), i);
  const SessionMailbox::Work work = mailbox_.Wait(Now());
  EXPECT_EQ(work.num_dropped, 4u);
  EXPECT_EQ(work.scan->seq, 5u);
}

TEST_F(OverloadTest, AFullQueueMakesRoomForTheNewest) {
  Attach(/*drop_oldest=*/true);
  for (std::uint64_t seq = 1; seq <= 9; ++seq) EXPECT_TRUE(Enqueue(seq, 0).may_read_on);
  const SessionMailbox::Enqueued tenth = Enqueue(10, 0);
  EXPECT_EQ(tenth.num_dropped, 1u);
  EXPECT_TRUE(tenth.may_read_on);
  EXPECT_EQ(mailbox_.load().queue_bytes, 900u);
  const SessionMailbox::Enqueued large = Enqueue(11, 0, 2000);
  EXPECT_EQ(large.num_dropped, 9u);  // the newest stays, too large or not
  EXPECT_FALSE(large.may_read_on);
  EXPECT_EQ(mailbox_.Wait(Now()).scan->seq, 11u);
}

TEST_F(OverloadTest, NothingIsDroppedOfARobotThatWouldRatherWait) {
  Attach(/*drop_oldest=*/false);
  for (std::uint64_t seq = 1; seq <= 9; ++seq) Enqueue(seq, static_cast<int>(1000 * seq));
  EXPECT_FALSE(Enqueue(10, 100'000).may_read_on);
  EXPECT_EQ(mailbox_.load().queue_bytes, 1000u);
  EXPECT_EQ(mailbox_.Wait(Now()).scan->seq, 1u);
}

/// A robot that never sends beyond its credit, over streams that come and go.
class CreditBook {
 public:
  explicit CreditBook(SessionMailbox& mailbox) : mailbox_(mailbox) { Reopen(); }

  void Reopen() {
    previous_ = std::exchange(sink_, std::make_shared<Sink>());
    const auto attached = mailbox_.Attach(sink_);
    ASSERT_TRUE(attached.ok());
    credit_bytes_ = attached->credit_bytes;
    next_seq_ = attached->resume_after_seq + 1;
  }
  void Vanish() { mailbox_.Detach(sink_.get()); }
  void Send(std::uint64_t bytes) {
    if (bytes > credit_bytes_) return;
    credit_bytes_ -= bytes;
    mailbox_.Enqueue(sink_.get(), ScanOf(next_seq_++, bytes));
  }
  void SendDuplicate(std::uint64_t bytes) {
    if (bytes > credit_bytes_ || next_seq_ == 1) return;
    credit_bytes_ -= bytes;
    mailbox_.Enqueue(sink_.get(), ScanOf(next_seq_ - 1, bytes));
  }
  /// Of the stream before this one: ignored.
  void SendLate(std::uint64_t bytes) {
    if (previous_ != nullptr) mailbox_.Enqueue(previous_.get(), ScanOf(next_seq_, bytes));
  }
  void Read() { credit_bytes_ += mailbox_.TakeProgress(sink_.get()).credit_bytes; }
  std::uint64_t credit_bytes() const { return credit_bytes_; }

 private:
  SessionMailbox& mailbox_;
  std::shared_ptr<Sink> sink_, previous_;
  std::uint64_t credit_bytes_ = 0;
  std::uint64_t next_seq_ = 1;
};

TEST(SessionMailbox, NoCreditIsLostOrMadeOverHundredsOfTakeOvers) {
  // What a robot may send and what of it still waits add up to the whole, always.
  constexpr std::uint64_t kWhole_bytes = 1000;
  SessionMailbox mailbox(kWhole_bytes);
  CreditBook robot(mailbox);
  std::deque<IngestMessage> in_hand;
  std::uint64_t waiting_bytes = 0;
  std::mt19937 random(1);
  int num_take_overs = 0;
  for (int i = 0; i < 20'000; ++i) {
    const std::uint64_t before = robot.credit_bytes();
    const std::uint64_t bytes = 1 + random() % 200;
    switch (random() % 8) {
      case 0:
        robot.Reopen();
        ++num_take_overs;
        ASSERT_EQ(robot.credit_bytes() + waiting_bytes, kWhole_bytes) << i;
        break;
      case 1:
        robot.Vanish();
        robot.Reopen();
        break;
      case 2:
        robot.SendDuplicate(bytes);
        break;
      case 3:
        robot.SendLate(bytes);
        break;
      case 4:
        if (SessionMailbox::Work work = mailbox.Wait(Now()); work.scan.has_value())
          in_hand.push_back(*std::move(work.scan));
        break;
      case 5:
        if (in_hand.empty()) break;
        mailbox.FinishScan(in_hand.front(), std::nullopt);
        waiting_bytes -= in_hand.front().credit_bytes;
        in_hand.pop_front();
        break;
      default:
        robot.Send(bytes);
        waiting_bytes += before - robot.credit_bytes();
        break;
    }
    robot.Read();
    ASSERT_EQ(robot.credit_bytes() + waiting_bytes, kWhole_bytes) << i;
  }
  EXPECT_GT(num_take_overs, 2000);
}

TEST_F(SessionMailboxTest, ListsSomeProblemsAndCountsTheRest) {
  for (std::uint64_t seq = 1; seq <= 40; ++seq) {
    mailbox_.Enqueue(sink_.get(), ScanOf(seq, 1));
    const SessionMailbox::Work work = mailbox_.Wait(Now());
    mailbox_.FinishScan(*work.scan, IngestProblem{seq, wire::ProblemReason::kMalformed, "why", 0});
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
  mailbox_.FinishScan(*first.scan, std::nullopt);
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
  EXPECT_TRUE(mailbox_.Enqueue(sink_.get(), poses).may_read_on);
  EXPECT_FALSE(mailbox_.Enqueue(sink_.get(), poses).may_read_on);
  EXPECT_EQ(mailbox_.load().queue_bytes, 1998u);
  EXPECT_EQ(mailbox_.Wait(Now()).poses.size(), 2u);
  mailbox_.FinishPoses(poses, std::nullopt);
  EXPECT_TRUE(mailbox_.HasRoom());
  EXPECT_FALSE(mailbox_.idle());
  mailbox_.FinishPoses(poses, std::nullopt);
  mailbox_.FinishScan(*work.scan, std::nullopt);
  EXPECT_TRUE(mailbox_.idle());
  EXPECT_EQ(mailbox_.load().queue_bytes, 0u);
}

TEST_F(SessionMailboxTest, SeveralScansMayBeInHand) {
  mailbox_.Enqueue(sink_.get(), ScanOf(1, 10));
  mailbox_.Enqueue(sink_.get(), ScanOf(2, 10));
  const SessionMailbox::Work first = mailbox_.Wait(Now());
  const SessionMailbox::Work second = mailbox_.Wait(Now());
  EXPECT_EQ(mailbox_.load().oldest, first.scan->arrived);
  mailbox_.FinishScan(*first.scan, std::nullopt);
  EXPECT_EQ(mailbox_.load().oldest, second.scan->arrived);
  mailbox_.Detach(sink_.get());
  EXPECT_FALSE(mailbox_.CloseDoor(/*only_if_alone=*/true));
  mailbox_.FinishScan(*second.scan, std::nullopt);
  EXPECT_EQ(mailbox_.load().oldest, std::nullopt);
  EXPECT_TRUE(mailbox_.CloseDoor(/*only_if_alone=*/true));
}

TEST_F(SessionMailboxTest, TellsTheEndToWhoeverComesBackForIt) {
  const auto late = std::make_shared<Sink>(), later = std::make_shared<Sink>();
  EXPECT_FALSE(mailbox_.AttachForEnd(late)->ending);
  EXPECT_EQ(mailbox_.sink(), sink_);
  mailbox_.RequestEnd(sink_.get());
  const SessionMailbox::EndOutlook pending = *mailbox_.AttachForEnd(late);
  EXPECT_TRUE(pending.ending);
  EXPECT_FALSE(pending.end.has_value());
  EXPECT_EQ(pending.previous, sink_);
  EXPECT_EQ(mailbox_.SetEnd(SessionEnd{{1, 2}, 3, 4, 5}), late);
  const SessionMailbox::EndOutlook known = *mailbox_.AttachForEnd(later);
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
