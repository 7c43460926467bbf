// The queue of one session, bounded in bytes, and the progress that its stream reports.
// Thread-safe: the stream puts in, the session's thread takes out.
#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "core/base/mutex.h"
#include "server/ingest_budget.h"
#include "server/ingest_message.h"

namespace gem {

class SessionMailbox {
 public:
  /// Reading stops when so many bytes wait. Of a stream that drops scans, one that has waited
  /// longer than `overload_age_max` gives way to newer ones, and so do the oldest when the queue is
  /// full; the newest is never dropped.
  /// budget: of all sessions, outlives the mailbox; when it is scarce, less may wait. May be null.
  explicit SessionMailbox(std::uint64_t queue_bytes_max,
                          Clock::duration overload_age_max = Clock::duration::max(),
                          IngestBudget* budget = nullptr)
      : queue_bytes_max_(queue_bytes_max), overload_age_max_(overload_age_max), budget_(budget) {}
  ~SessionMailbox();
  SessionMailbox(const SessionMailbox&) = delete;
  SessionMailbox& operator=(const SessionMailbox&) = delete;

  // For streams.
  struct Attached {
    std::uint64_t resume_after_seq = 0;
    std::uint64_t credit_bytes = 0;
    std::shared_ptr<IngestSink> previous;  ///< to be told that it was taken over
  };
  /// Makes `sink` the session's stream. FAILED_PRECONDITION once the session is ending, ABORTED for
  /// an opening that a later one of the same process has overtaken.
  absl::StatusOr<Attached> Attach(std::shared_ptr<IngestSink> sink, IngestOpening opening = {});
  /// Does nothing if another sink is attached.
  void Detach(const IngestSink* sink);
  enum class Verdict : std::uint8_t {
    kTaken,
    kDuplicate,  ///< of a scan that was accepted; acknowledged again, and gone
    kOutOfLine,  ///< not the next scan: refused, and gone
    kStranger,   ///< the sink is not attached: gone
  };
  struct Enqueued {
    Verdict verdict = Verdict::kTaken;
    bool may_read_on = true;        ///< false: not before OnProgress()
    std::uint64_t num_dropped = 0;  ///< scans that gave way to this message
  };
  /// Judges the order of the message and takes it in. What is not taken in is gone and waits for
  /// nothing; TakeProgress() has the news.
  Enqueued Enqueue(const IngestSink* sink, IngestMessage message);
  bool HasRoom() const;
  /// How many bytes may wait now.
  std::uint64_t bytes_limit() const;
  bool HasScans() const;
  /// The session ends when what waits is done.
  void RequestEnd(const IngestSink* sink);
  /// A problem that was found before the session saw the message.
  void AddProblem(const IngestSink* sink, IngestProblem problem);
  /// What happened since the last call, and the credit that fills up what the robot may have on
  /// its way: what is done, and more or less if the limit has changed. Nothing for a sink that is
  /// not attached.
  IngestProgress TakeProgress(const IngestSink* sink);
  /// For a stream that comes back to hear how the session ended.
  struct EndOutlook {
    bool ending = false;                            ///< false: nothing was attached
    std::optional<absl::StatusOr<SessionEnd>> end;  ///< unset: OnEnded() will tell
    std::shared_ptr<IngestSink> previous;           ///< to be told that it was taken over
  };
  /// ABORTED as Attach().
  absl::StatusOr<EndOutlook> AttachForEnd(std::shared_ptr<IngestSink> sink,
                                          IngestOpening opening = {});
  /// Nothing waits and nothing is in hand.
  bool idle() const;

  // For the session's thread.
  struct Work {
    std::vector<IngestMessage> poses;   ///< all that wait
    std::optional<IngestMessage> scan;  ///< the oldest; in hand until FinishScan()
    std::uint64_t num_dropped = 0;      ///< scans that gave way to it
    bool end_requested = false;         ///< and no scan is left
    bool stopped = false;
  };
  /// Waits for work until the deadline, or until the stream leaves. Several scans may be in hand:
  /// they wait for poses. Half of the queue is kept free of them, so that poses can come.
  Work Wait(Clock::time_point deadline);
  /// The oldest scan in hand is done: fused (without problem) or refused.
  void FinishScan(const IngestMessage& scan, const std::optional<IngestProblem>& problem);
  /// A batch of poses is done.
  void FinishPoses(const IngestMessage& poses, const std::optional<IngestProblem>& problem);
  /// No stream may attach any more. False, and nothing is closed, if `only_if_alone` and a stream
  /// is there or something waits.
  bool CloseDoor(bool only_if_alone);
  /// Remembers how the session ended, unless it had ended before. Returns the stream that is to be
  /// told, if there is one.
  std::shared_ptr<IngestSink> SetEnd(const absl::StatusOr<SessionEnd>& end);
  /// True from SetEnd() on.
  bool has_end() const;
  /// When the last stream left or the last message came, whichever is later.
  Clock::time_point idle_since() const;

  // For everybody.
  void Stop();
  std::shared_ptr<IngestSink> sink() const;
  struct Load {
    std::uint64_t queue_bytes = 0;
    std::optional<Clock::time_point> oldest;  ///< arrival of the oldest message not done
    std::uint64_t fused_seq = 0;
    bool connected = false;
  };
  Load load() const;

 private:
  struct InHand {
    Clock::time_point arrived;
    std::uint64_t seq = 0;
  };
  absl::Status TakeOverLocked(IngestOpening opening) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  /// Every accepted scan is in hand, waits, or is done, in this order.
  std::uint64_t FusedSeqLocked() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  Verdict JudgeLocked(const IngestMessage& message) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  /// What may be granted without going beyond the limit.
  std::uint64_t GrantLocked() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  /// Returns how many.
  std::uint64_t DropLocked(Clock::time_point now) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  bool HasRoomLocked() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void ReleaseLocked(const IngestMessage& message, const std::optional<IngestProblem>& problem)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void AddProblemLocked(IngestProblem problem) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  // Constant after construction.
  const std::uint64_t queue_bytes_max_;
  const Clock::duration overload_age_max_;
  IngestBudget* const budget_;

  mutable Mutex mutex_;
  CondVar changed_;
  std::shared_ptr<IngestSink> sink_ ABSL_GUARDED_BY(mutex_);
  IngestOpening opening_ ABSL_GUARDED_BY(mutex_);  ///< of the newest sink
  std::deque<IngestMessage> scans_ ABSL_GUARDED_BY(mutex_);
  std::deque<IngestMessage> poses_ ABSL_GUARDED_BY(mutex_);
  std::deque<InHand> in_hand_ ABSL_GUARDED_BY(mutex_);       ///< oldest first
  std::uint64_t in_hand_bytes_ ABSL_GUARDED_BY(mutex_) = 0;  ///< part of queue_bytes_
  std::uint64_t queue_bytes_ ABSL_GUARDED_BY(mutex_) = 0;
  /// What the stream's robot may still send; negative if it sent more than it might.
  std::int64_t credit_bytes_ ABSL_GUARDED_BY(mutex_) = 0;
  std::uint64_t spent_credit_bytes_ ABSL_GUARDED_BY(mutex_) = 0;  ///< of what is not done
  std::uint64_t accepted_seq_ ABSL_GUARDED_BY(mutex_) = 0;
  IngestProgress progress_ ABSL_GUARDED_BY(mutex_);
  Clock::time_point idle_since_ ABSL_GUARDED_BY(mutex_) = Clock::now();
  bool end_requested_ ABSL_GUARDED_BY(mutex_) = false;
  bool detached_ ABSL_GUARDED_BY(mutex_) = false;  ///< since the last Wait()
  bool door_closed_ ABSL_GUARDED_BY(mutex_) = false;
  bool stopped_ ABSL_GUARDED_BY(mutex_) = false;
  std::optional<absl::StatusOr<SessionEnd>> end_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace gem
