#include "server/session_actor.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "core/base/thread_name.h"
#include "spdlog/spdlog.h"

namespace gem {
namespace {

std::chrono::nanoseconds Seconds(double seconds) {
  return std::chrono::nanoseconds(static_cast<std::int64_t>(seconds * 1e9));
}

IngestProblem ProblemOf(std::uint64_t seq, const absl::Status& status) {
  return {seq, wire::ReasonOf(status), std::string(status.message())};
}

}  // namespace

SessionActor::SessionActor(SessionConfig config, std::shared_ptr<MapActor> map,
                           std::shared_ptr<LocalMapFeed> feed, const SessionActorOptions& options,
                           IngestBudget& budget, Metrics& metrics)
    : config_(std::move(config)),
      map_(std::move(map)),
      feed_(std::move(feed)),
      feed_ticket_(feed_->Begin({config_.setup.session, map_, config_.setup.T_G_O})),
      options_(options),
      metrics_(metrics),
      mailbox_(std::make_shared<SessionMailbox>(options.queue_bytes_max,
                                                Seconds(options.overload_age_s_max), &budget)),
      thread_([this] { Run(); }) {}

SessionActor::~SessionActor() {
  Stop();
  Join();
}

void SessionActor::Stop() { mailbox_->Stop(); }

void SessionActor::Abandon(const absl::Status& why) {
  // In this order: a stream that attaches is refused, or there to be told.
  mailbox_->Stop();
  if (const std::shared_ptr<IngestSink> sink = mailbox_->SetEnd(why)) sink->OnEnded(why);
}

void SessionActor::Join() {
  if (thread_.joinable()) thread_.join();
}

void SessionActor::Run() {
  NameThread("session");
  // On this thread: a window of a million cells takes a while to allocate.
  SessionMapper mapper(config_);
  while (true) {
    SessionMailbox::Work work = mailbox_->Wait(NextDeadline());
    if (work.stopped) break;
    CountDropped(work.num_dropped);
    TakePoses(mapper, work.poses);
    const bool has_scan = work.scan.has_value();
    if (has_scan) TakeScan(mapper, *std::move(work.scan));
    const bool idle_too_long =
        Clock::now() - mailbox_->idle_since() >= Seconds(options_.session_idle_s_max);
    ServeLine(mapper, work.end_requested || idle_too_long);
    // What waits in line leaves room in the queue: the poses may be next on the stream.
    // So does what was dropped.
    if ((has_scan && !line_.empty()) || work.num_dropped > 0) TellStream();
    if (work.end_requested || idle_too_long) {
      if (mailbox_->CloseDoor(/*only_if_alone=*/!work.end_requested)) {
        End(mapper);
        break;
      }
    }
    PublishWhatIsDue(mapper);
  }
  active_.store(false, std::memory_order_release);
}

Clock::time_point SessionActor::NextDeadline() const {
  Clock::time_point deadline = mailbox_->idle_since() + Seconds(options_.session_idle_s_max);
  if (!line_.empty())
    deadline = std::min(deadline, line_.front().since + Seconds(options_.pose_wait_s_max));
  if (map_is_old_) deadline = std::min(deadline, last_publish_ + Seconds(1 / options_.publish_hz));
  return deadline;
}

void SessionActor::TakePoses(SessionMapper& mapper, const std::vector<IngestMessage>& batches) {
  for (const IngestMessage& batch : batches) {
    const absl::Status status = mapper.AddPoses(*batch.poses);
    metrics_.CountPoses(status.ok());
    std::optional<IngestProblem> problem;
    if (!status.ok()) problem = ProblemOf(0, status);
    mailbox_->FinishPoses(batch, problem);
  }
  if (!batches.empty()) TellStream();
}

bool SessionActor::Enqueue(const IngestSink* sink, IngestMessage message) {
  const SessionMailbox::Enqueued enqueued = mailbox_->Enqueue(sink, std::move(message));
  switch (enqueued.verdict) {
    case SessionMailbox::Verdict::kDuplicate:
      metrics_.CountDuplicateScan();
      break;
    case SessionMailbox::Verdict::kOutOfLine:
      metrics_.CountRefusedScan(wire::ProblemReason::kOutOfOrder);
      num_refused_.fetch_add(1, std::memory_order_relaxed);
      break;
    case SessionMailbox::Verdict::kTaken:
    case SessionMailbox::Verdict::kStranger:
      break;
  }
  CountDropped(enqueued.num_dropped);
  return enqueued.may_read_on;
}

void SessionActor::CountDropped(std::uint64_t num_dropped) {
  metrics_.CountDroppedScans(num_dropped);
  num_dropped_.fetch_add(num_dropped, std::memory_order_relaxed);
}

void SessionActor::TakeScan(SessionMapper& mapper, IngestMessage message) {
  InLine scan;
  scan.status = mapper.Take(std::move(message.scan), scan.held);
  scan.size_bytes = std::max(scan.held.size_bytes(), message.size_bytes);
  scan.since = Clock::now();
  scan.message = std::move(message);
  line_bytes_ += scan.size_bytes;
  line_.push_back(std::move(scan));
}

void SessionActor::ServeLine(SessionMapper& mapper, bool ending) {
  while (!line_.empty() && ServeFront(mapper, ending)) {
  }
}

bool SessionActor::ServeFront(SessionMapper& mapper, bool ending) {
  InLine& front = line_.front();
  absl::Status status = front.status;
  if (status.ok()) {
    const auto readiness = mapper.Prepare(front.held, WhyGiveUp(ending));
    if (readiness.ok() && *readiness == SessionMapper::Readiness::kWaits) return false;
    status = readiness.status();
    if (readiness.ok()) Fuse(mapper, front.held, front.message.arrived);
  }
  FinishFront(mapper, status);
  return true;
}

std::string SessionActor::WhyGiveUp(bool ending) const {
  const Clock::duration waited = Clock::now() - line_.front().since;
  const std::uint64_t bytes_max = std::min(mailbox_->bytes_limit(), options_.queue_bytes_max / 2);
  std::string why;
  if (ending) {
    why = "the session ends";
  } else if (line_.size() > static_cast<std::size_t>(options_.waiting_scans_max)) {
    why = absl::StrCat(line_.size(), " scans wait, at most ", options_.waiting_scans_max, " may");
  } else if (line_.size() > 1 && line_bytes_ > bytes_max) {
    why = absl::StrCat(line_bytes_, " bytes of scans wait, at most ", bytes_max, " may");
  } else if (waited < Seconds(options_.pose_wait_s_max)) {
    return why;
  }
  const double waited_s = std::chrono::duration<double>(waited).count();
  return absl::StrCat(
      why, why.empty() ? "" : ", ",
      absl::StrFormat("waited %.2f s, at most %g", waited_s, options_.pose_wait_s_max));
}

void SessionActor::FinishFront(SessionMapper& mapper, const absl::Status& status) {
  InLine front = std::move(line_.front());
  line_.pop_front();
  line_bytes_ -= front.size_bytes;
  std::optional<IngestProblem> problem;
  if (!status.ok()) {
    problem = ProblemOf(front.message.seq, status);
    metrics_.CountRefusedScan(problem->reason);
    num_refused_.fetch_add(1, std::memory_order_relaxed);
  }
  mailbox_->FinishScan(front.message, problem);
  mapper.Recycle(std::move(front.held));
  TellStream();
}

void SessionActor::Fuse(SessionMapper& mapper, SessionMapper::HeldScan& held,
                        Clock::time_point arrived) {
  const ScanReport report = mapper.Fuse(held);
  metrics_.ObserveScan(report, std::chrono::duration<double>(Clock::now() - arrived).count());
  num_fused_.fetch_add(1, std::memory_order_relaxed);
  if (held.deskewing != SessionMapper::Deskewing::kNotNeeded) {
    const bool done = held.deskewing == SessionMapper::Deskewing::kDone;
    metrics_.CountDeskew(done);
    if (!done) ++num_not_deskewed_;
  }
  local_map_is_old_ = map_is_old_ = true;
  // Before the scan is acknowledged: who sees the acknowledgement of the last scan finds it in the
  // local map. A busy session copies at a bounded rate.
  const bool copy_is_due =
      Clock::now() - last_local_publish_ >= Seconds(1 / options_.local_publish_hz);
  if (copy_is_due || !mailbox_->HasScans()) PublishLocalMap(mapper);
}

void SessionActor::PublishLocalMap(const SessionMapper& mapper) {
  local_map_ = mapper.CopyLocalMap();
  last_local_publish_ = Clock::now();
  local_map_is_old_ = false;
  feed_->Publish(feed_ticket_, local_map_);
}

void SessionActor::PublishWhatIsDue(SessionMapper& mapper) {
  const bool due = Clock::now() - last_publish_ >= Seconds(1 / options_.publish_hz);
  // A submap that is finished goes at once, and with it the live parts of the same moment: a cell
  // must not be missing from one because it has gone over to the other.
  if (!mapper.has_finished_submaps() && !(map_is_old_ && due)) return;
  if (local_map_is_old_) PublishLocalMap(mapper);
  map_->Update(config_.setup.session, mapper.TakeUpdate(local_map_), nullptr);
  last_publish_ = Clock::now();
  map_is_old_ = false;
}

void SessionActor::End(SessionMapper& mapper) {
  if (local_map_is_old_) PublishLocalMap(mapper);
  local_map_ = nullptr;
  const SessionEnd counts{
      {}, num_scans_fused(), num_scans_refused(), num_not_deskewed_, num_scans_dropped()};
  active_.store(false, std::memory_order_release);
  spdlog::info("session {} of robot {} ended: {} scans fused, {} refused, {} dropped",
               config_.setup.session, config_.setup.robot, counts.num_scans_fused,
               counts.num_scans_refused, counts.num_scans_dropped);
  map_->Update(config_.setup.session, mapper.End(),
               [mailbox = mailbox_, counts](const absl::StatusOr<MapVersion>& version) {
                 absl::StatusOr<SessionEnd> end = counts;
                 if (version.ok()) {
                   end->version = *version;
                 } else {
                   end = version.status();
                 }
                 if (const auto sink = mailbox->SetEnd(end)) sink->OnEnded(end);
               });
}

void SessionActor::TellStream() const {
  if (const std::shared_ptr<IngestSink> sink = mailbox_->sink()) sink->OnProgress();
}

}  // namespace gem
