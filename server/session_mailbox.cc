#include "server/session_mailbox.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "core/base/status_macros.h"

namespace gem {
namespace {

/// Problems listed in one answer; more are counted only, so that a stream of rubbish costs little.
constexpr std::size_t kProblemsListed_max = 32;

}  // namespace

absl::StatusOr<SessionMailbox::Attached> SessionMailbox::Attach(std::shared_ptr<IngestSink> sink,
                                                                IngestOpening opening) {
  MutexLock lock(mutex_);
  if (door_closed_ || end_requested_ || stopped_) return absl::FailedPreconditionError("has ended");
  GEM_RETURN_IF_ERROR(TakeOverLocked(opening));
  Attached attached;
  attached.previous = std::exchange(sink_, std::move(sink));
  attached.resume_after_seq = accepted_seq_;
  // What still waits from the stream before is paid back to this one as it drains.
  credit_bytes_ = 0;
  attached.credit_bytes = GrantLocked();
  progress_ = {};
  return attached;
}

SessionMailbox::~SessionMailbox() {
  if (budget_ != nullptr) budget_->GiveBack(queue_bytes_);
}

std::uint64_t SessionMailbox::bytes_limit() const {
  return budget_ == nullptr ? queue_bytes_max_ : std::min(queue_bytes_max_, budget_->share_bytes());
}

std::uint64_t SessionMailbox::GrantLocked() {
  const std::int64_t out_bytes = credit_bytes_ + static_cast<std::int64_t>(spent_credit_bytes_);
  const std::int64_t granted_bytes =
      std::max<std::int64_t>(0, static_cast<std::int64_t>(bytes_limit()) - out_bytes);
  credit_bytes_ += granted_bytes;
  return static_cast<std::uint64_t>(granted_bytes);
}

absl::Status SessionMailbox::TakeOverLocked(IngestOpening opening) {
  if (opening.opener != 0 && opening.opener == opening_.opener &&
      opening.attempt <= opening_.attempt)
    return absl::AbortedError(absl::StrCat("open.attempt is ", opening.attempt, ", want more than ",
                                           opening_.attempt,
                                           ": another stream has resumed the session"));
  opening_ = opening;
  return absl::OkStatus();
}

absl::StatusOr<SessionMailbox::EndOutlook> SessionMailbox::AttachForEnd(
    std::shared_ptr<IngestSink> sink, IngestOpening opening) {
  MutexLock lock(mutex_);
  EndOutlook outlook;
  outlook.ending = end_.has_value() || door_closed_ || end_requested_;
  outlook.end = end_;
  if (!outlook.ending || end_.has_value()) return outlook;
  GEM_RETURN_IF_ERROR(TakeOverLocked(opening));
  outlook.previous = std::exchange(sink_, std::move(sink));
  return outlook;
}

std::shared_ptr<IngestSink> SessionMailbox::SetEnd(const absl::StatusOr<SessionEnd>& end) {
  MutexLock lock(mutex_);
  if (end_.has_value()) return nullptr;
  end_ = end;
  return sink_;
}

bool SessionMailbox::has_end() const {
  MutexLock lock(mutex_);
  return end_.has_value();
}

void SessionMailbox::Detach(const IngestSink* sink) {
  MutexLock lock(mutex_);
  if (sink_.get() != sink) return;
  sink_ = nullptr;
  idle_since_ = Clock::now();
  detached_ = true;
  changed_.NotifyOne();
}

SessionMailbox::Enqueued SessionMailbox::Enqueue(const IngestSink* sink, IngestMessage message) {
  MutexLock lock(mutex_);
  if (sink_.get() != sink || stopped_) return {Verdict::kStranger, true, 0};
  idle_since_ = Clock::now();
  const Clock::time_point now = message.arrived;
  const Verdict verdict = JudgeLocked(message);
  credit_bytes_ -= static_cast<std::int64_t>(message.credit_bytes);
  if (verdict == Verdict::kTaken) {
    queue_bytes_ += message.size_bytes;
    if (budget_ != nullptr) budget_->Take(message.size_bytes);
    spent_credit_bytes_ += message.credit_bytes;
    (message.scan != nullptr ? scans_ : poses_).push_back(std::move(message));
    changed_.NotifyOne();
  } else {
    progress_.news = true;
  }
  const std::uint64_t num_dropped = DropLocked(now);
  return {verdict, HasRoomLocked(), num_dropped};
}

std::uint64_t SessionMailbox::DropLocked(Clock::time_point now) {
  std::uint64_t num_dropped = 0;
  while (opening_.drop_oldest && scans_.size() > 1) {
    const IngestMessage& oldest = scans_.front();
    const Clock::duration age = now - oldest.arrived;
    if (age <= overload_age_max_ && HasRoomLocked()) break;
    ReleaseLocked(oldest, IngestProblem{oldest.seq, wire::ProblemReason::kDropped,
                                        absl::StrFormat("waited %.2f s, and newer scans came",
                                                        std::chrono::duration<double>(age).count()),
                                        0});
    scans_.pop_front();
    ++num_dropped;
  }
  return num_dropped;
}

SessionMailbox::Verdict SessionMailbox::JudgeLocked(const IngestMessage& message) {
  if (message.scan == nullptr) return Verdict::kTaken;
  const std::uint64_t expected_seq = accepted_seq_ + 1;
  // The session's thread consumes every scan that is next in line, refused or not, so that what is
  // accepted is known before the scan is looked at.
  if (message.seq == expected_seq) {
    accepted_seq_ = message.seq;
    return Verdict::kTaken;
  }
  // A resumed stream repeats what it does not know to have arrived.
  if (message.seq != 0 && message.seq < expected_seq) return Verdict::kDuplicate;
  AddProblemLocked({message.seq, wire::ProblemReason::kOutOfOrder,
                    absl::StrCat("scan.seq is ", message.seq, ", want ", expected_seq,
                                 ", the one after the last"),
                    expected_seq});
  return Verdict::kOutOfLine;
}

bool SessionMailbox::HasRoom() const {
  MutexLock lock(mutex_);
  return HasRoomLocked();
}

bool SessionMailbox::HasRoomLocked() const {
  // Scans in hand may wait for poses that have not been read yet: one that fills the whole queue
  // must not keep them out.
  const std::uint64_t limit = bytes_limit();
  const std::uint64_t in_hand_bytes = std::min(in_hand_bytes_, limit / 2);
  return queue_bytes_ - in_hand_bytes_ + in_hand_bytes < limit;
}

bool SessionMailbox::HasScans() const {
  MutexLock lock(mutex_);
  return !scans_.empty();
}

void SessionMailbox::RequestEnd(const IngestSink* sink) {
  MutexLock lock(mutex_);
  if (sink_.get() != sink) return;
  end_requested_ = true;
  changed_.NotifyOne();
}

void SessionMailbox::AddProblem(const IngestSink* sink, IngestProblem problem) {
  MutexLock lock(mutex_);
  if (sink_.get() == sink) AddProblemLocked(std::move(problem));
}

IngestProgress SessionMailbox::TakeProgress(const IngestSink* sink) {
  MutexLock lock(mutex_);
  if (sink_.get() != sink) return {};
  IngestProgress progress = std::exchange(progress_, {});
  if (progress.news) progress.credit_bytes = GrantLocked();
  progress.accepted_seq = accepted_seq_;
  progress.fused_seq = FusedSeqLocked();
  return progress;
}

std::uint64_t SessionMailbox::FusedSeqLocked() const {
  if (!in_hand_.empty()) return in_hand_.front().seq - 1;
  return scans_.empty() ? accepted_seq_ : scans_.front().seq - 1;
}

bool SessionMailbox::idle() const {
  MutexLock lock(mutex_);
  return scans_.empty() && poses_.empty() && in_hand_.empty();
}

SessionMailbox::Work SessionMailbox::Wait(Clock::time_point deadline) {
  MutexLock lock(mutex_);
  while (!stopped_ && scans_.empty() && poses_.empty() && !end_requested_ && !detached_)
    if (!changed_.WaitUntil(mutex_, deadline)) break;
  detached_ = false;
  Work work;
  work.stopped = stopped_;
  if (stopped_) return work;
  work.num_dropped = DropLocked(Clock::now());
  work.poses.assign(std::make_move_iterator(poses_.begin()), std::make_move_iterator(poses_.end()));
  poses_.clear();
  if (!scans_.empty()) {
    work.scan = std::move(scans_.front());
    scans_.pop_front();
    in_hand_.push_back({work.scan->arrived, work.scan->seq});
    in_hand_bytes_ += work.scan->size_bytes;
  }
  work.end_requested = end_requested_ && !work.scan.has_value();
  return work;
}

void SessionMailbox::FinishScan(const IngestMessage& scan,
                                const std::optional<IngestProblem>& problem) {
  MutexLock lock(mutex_);
  in_hand_.pop_front();
  in_hand_bytes_ -= scan.size_bytes;
  progress_.news = true;
  ReleaseLocked(scan, problem);
}

void SessionMailbox::FinishPoses(const IngestMessage& poses,
                                 const std::optional<IngestProblem>& problem) {
  MutexLock lock(mutex_);
  ReleaseLocked(poses, problem);
}

void SessionMailbox::ReleaseLocked(const IngestMessage& message,
                                   const std::optional<IngestProblem>& problem) {
  queue_bytes_ -= message.size_bytes;
  if (budget_ != nullptr) budget_->GiveBack(message.size_bytes);
  spent_credit_bytes_ -= message.credit_bytes;
  idle_since_ = Clock::now();
  if (problem.has_value()) AddProblemLocked(*problem);
}

void SessionMailbox::AddProblemLocked(IngestProblem problem) {
  progress_.news = true;
  if (progress_.problems.size() < kProblemsListed_max) {
    progress_.problems.push_back(std::move(problem));
  } else {
    ++progress_.problems_left_out;
  }
}

bool SessionMailbox::CloseDoor(bool only_if_alone) {
  MutexLock lock(mutex_);
  const bool alone = sink_ == nullptr && scans_.empty() && poses_.empty() && in_hand_.empty();
  if (only_if_alone && !alone) return false;
  door_closed_ = true;
  return true;
}

Clock::time_point SessionMailbox::idle_since() const {
  MutexLock lock(mutex_);
  // While a stream is there the session waits for its robot, however long it says nothing: dead
  // connections are found by keepalive.
  return sink_ != nullptr ? Clock::now() : idle_since_;
}

void SessionMailbox::Stop() {
  MutexLock lock(mutex_);
  stopped_ = true;
  changed_.NotifyAll();
}

std::shared_ptr<IngestSink> SessionMailbox::sink() const {
  MutexLock lock(mutex_);
  return sink_;
}

SessionMailbox::Load SessionMailbox::load() const {
  MutexLock lock(mutex_);
  Load load{queue_bytes_, std::nullopt, FusedSeqLocked(), sink_ != nullptr};
  if (!in_hand_.empty()) {
    load.oldest = in_hand_.front().arrived;
  } else if (!scans_.empty()) {
    load.oldest = scans_.front().arrived;
  }
  return load;
}

}  // namespace gem
