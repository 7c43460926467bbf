#include "server/session_actor.h"

#include <algorithm>
#include <utility>

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
                           const SessionActorOptions& options, Metrics& metrics)
    : config_(std::move(config)),
      map_(std::move(map)),
      options_(options),
      metrics_(metrics),
      mailbox_(std::make_shared<SessionMailbox>(options.queue_bytes_max)),
      thread_([this] { Run(); }) {}

SessionActor::~SessionActor() {
  Stop();
  thread_.join();
}

std::shared_ptr<const LocalMap> SessionActor::local_map() const {
  MutexLock lock(mutex_);
  return local_map_;
}

void SessionActor::DropLocalMap() {
  MutexLock lock(mutex_);
  local_map_ = nullptr;
}

void SessionActor::Stop() { mailbox_->Stop(); }

void SessionActor::Run() {
  // On this thread: a window of a million cells takes a while to allocate.
  SessionMapper mapper(config_);
  while (true) {
    const SessionMailbox::Work work = mailbox_->Wait(NextDeadline());
    if (work.stopped) break;
    TakePoses(mapper, work.poses);
    if (work.scan.has_value()) ProcessScan(mapper, *work.scan);
    const bool idle_too_long =
        Clock::now() - mailbox_->idle_since() >= Seconds(options_.session_idle_s_max);
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

void SessionActor::ProcessScan(SessionMapper& mapper, const IngestMessage& message) {
  const absl::Status status = FuseScan(mapper, message);
  std::optional<IngestProblem> problem;
  if (!status.ok()) {
    problem = ProblemOf(message.seq, status);
    metrics_.CountRefusedScan(problem->reason);
    num_refused_.fetch_add(1, std::memory_order_relaxed);
  }
  mailbox_->FinishScan(message, mapper.last_seq(), problem);
  TellStream();
}

absl::Status SessionActor::FuseScan(SessionMapper& mapper, const IngestMessage& message) {
  const auto intake = mapper.Take(*message.scan, message.seq);
  if (!intake.ok()) return intake.status();
  if (*intake == SessionMapper::Intake::kDuplicate) {
    metrics_.CountDuplicateScan();
    return absl::OkStatus();
  }
  if (WaitForPose(mapper) != SessionMapper::PoseSearch::kFound) return mapper.RefuseForPose();
  metrics_.ObserveScan(mapper.Fuse());
  num_fused_.fetch_add(1, std::memory_order_relaxed);
  local_map_is_old_ = map_is_old_ = true;
  // Before the scan is acknowledged: who sees the acknowledgement of the last scan finds it in the
  // local map. A busy session copies at a bounded rate.
  const bool copy_is_due =
      Clock::now() - last_local_publish_ >= Seconds(1 / options_.local_publish_hz);
  if (copy_is_due || !mailbox_->HasScans()) PublishLocalMap(mapper);
  return absl::OkStatus();
}

SessionMapper::PoseSearch SessionActor::WaitForPose(SessionMapper& mapper) {
  const Clock::time_point deadline = Clock::now() + Seconds(options_.pose_wait_s_max);
  while (true) {
    const SessionMapper::PoseSearch search = mapper.FindPose();
    if (search != SessionMapper::PoseSearch::kMayCome) return search;
    const std::vector<IngestMessage> batches = mailbox_->WaitForPoses(deadline);
    if (batches.empty()) return SessionMapper::PoseSearch::kNone;
    TakePoses(mapper, batches);
  }
}

void SessionActor::PublishLocalMap(const SessionMapper& mapper) {
  std::shared_ptr<const LocalMap> copy = mapper.CopyLocalMap();
  last_local_publish_ = Clock::now();
  local_map_is_old_ = false;
  MutexLock lock(mutex_);
  local_map_ = std::move(copy);
}

void SessionActor::PublishWhatIsDue(SessionMapper& mapper) {
  const bool due = Clock::now() - last_publish_ >= Seconds(1 / options_.publish_hz);
  // A submap that is finished goes at once, and with it the live parts of the same moment: a cell
  // must not be missing from one because it has gone over to the other.
  if (!mapper.has_finished_submaps() && !(map_is_old_ && due)) return;
  if (local_map_is_old_) PublishLocalMap(mapper);
  map_->Update(config_.setup.session, mapper.TakeUpdate(local_map()), nullptr);
  last_publish_ = Clock::now();
  map_is_old_ = false;
}

void SessionActor::End(SessionMapper& mapper) {
  if (local_map_is_old_) PublishLocalMap(mapper);
  const std::uint64_t num_fused = num_scans_fused();
  const std::uint64_t num_refused = num_scans_refused();
  active_.store(false, std::memory_order_release);
  spdlog::info("session {} of robot {} ended: {} scans fused, {} refused", config_.setup.session,
               config_.setup.robot, num_fused, num_refused);
  map_->Update(
      config_.setup.session, mapper.End(),
      [mailbox = mailbox_, num_fused, num_refused](const absl::StatusOr<MapVersion>& version) {
        const std::shared_ptr<IngestSink> sink = mailbox->sink();
        if (sink == nullptr) return;
        if (!version.ok()) return sink->OnEnded(version.status());
        sink->OnEnded(SessionEnd{*version, num_fused, num_refused});
      });
}

void SessionActor::TellStream() const {
  if (const std::shared_ptr<IngestSink> sink = mailbox_->sink()) sink->OnProgress();
}

}  // namespace gem
