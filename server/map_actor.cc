#include "server/map_actor.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "core/base/check.h"
#include "core/base/thread_name.h"
#include "core/base/thread_priority.h"
#include "proto/wire/refusal.h"
#include "server/retry.h"
#include "spdlog/spdlog.h"

namespace gem {
namespace {

absl::Status Deleted(const std::string& map) {
  return wire::WithField(absl::NotFoundError(absl::StrCat(
                             "map is ", map, ", which has been deleted, want an existing map")),
                         "map");
}

std::chrono::nanoseconds PeriodOf(double hz) {
  return std::chrono::nanoseconds(static_cast<std::int64_t>(1e9 / hz));
}

}  // namespace

MapActor::MapActor(std::string id, const GlobalMapOptions& options, std::uint64_t epoch,
                   const MapActorOptions& limits, Metrics& metrics)
    : MapActor(std::move(id), std::make_unique<GlobalMapper>(options, epoch), limits, metrics) {}

MapActor::MapActor(std::string id, std::unique_ptr<GlobalMapper> mapper,
                   const MapActorOptions& limits, Metrics& metrics)
    : id_(std::move(id)),
      options_(mapper->snapshot()->options),
      epoch_(mapper->snapshot()->version.epoch),
      limits_(limits),
      metrics_(metrics),
      mapper_(std::move(mapper)),
      last_commit_(Clock::now() - PeriodOf(limits.publish_hz)),
      history_(std::make_shared<MapHistory>(mapper_->snapshot(), limits.history)),
      correction_book_(static_cast<std::size_t>(limits.request_ids_max)),
      retraction_book_(static_cast<std::size_t>(limits.request_ids_max)) {
  for (const SessionInfo& info : snapshot()->sessions) {
    known_[info.session] = sessions_.size();
    sessions_.push_back({info.session, info.robot, info.T_G_O});
  }
  thread_ = std::thread([this] { Run(); });
}

MapActor::~MapActor() {
  Stop();
  Join();
}

absl::Status MapActor::AddSession(const std::string& session, const std::string& robot,
                                  const Pose<Global, Odom>& T_G_O) {
  MutexLock lock(mutex_);
  if (!status_.ok()) return status_;
  if (known_.contains(session))
    return absl::AlreadyExistsError(absl::StrCat("session is ", session, ", which the map ", id_,
                                                 " had before, want a new id"));
  if (sessions_.size() >= static_cast<std::size_t>(limits_.sessions_max))
    return absl::ResourceExhaustedError(absl::StrCat("map ", id_, " has had ", sessions_.size(),
                                                     " sessions, want at most ",
                                                     limits_.sessions_max));
  known_[session] = sessions_.size();
  sessions_.push_back({session, robot, T_G_O});
  added_.push_back({session, robot, T_G_O});
  NoteNewsLocked();
  changed_.NotifyOne();
  return absl::OkStatus();
}

void MapActor::Update(const std::string& session, SessionUpdate update,
                      PublishedCallback published) {
  const auto finished_max = static_cast<std::size_t>(limits_.finished_submaps_waiting_max);
  absl::Status ended;
  {
    MutexLock lock(mutex_);
    // Nothing that is finished is ever dropped, so the session waits: it alone, and only if the map
    // is that many submaps (kilometres of path) behind.
    while (status_.ok() && pending_[session].update.finished.size() >= finished_max) {
      urgent_ = true;
      changed_.NotifyOne();
      accepted_.Wait(mutex_);
    }
    ended = status_;
    if (ended.ok()) {
      PendingSession& pending = pending_[session];
      urgent_ = urgent_ || update.ended;
      Coalesce(pending, std::move(update));
      NoteNewsLocked();
      if (published != nullptr) pending.published.push_back(std::move(published));
      changed_.NotifyOne();
      return;
    }
  }
  if (published != nullptr) published(ended);
}

template <typename Result>
std::optional<absl::StatusOr<Result>> MapActor::AnswerAtOnceLocked(
    const RequestBook<Result>& book, const char* what, const std::string& session,
    const std::string& request_id) const {
  if (!status_.ok()) return status_;
  if (!known_.contains(session))
    return wire::WithField(
        absl::NotFoundError(
            absl::StrCat("session is ", session, ", want a session that feeds the map ", id_)),
        "session");
  if (const Result* earlier = book.Find(session, request_id)) return *earlier;
  if (book.num_waiting() >= limits_.corrections_waiting_max)
    return WithRetry(absl::ResourceExhaustedError(
                         absl::StrCat(book.num_waiting(), " ", what, " wait for the map ", id_,
                                      ", want at most ", limits_.corrections_waiting_max)),
                     1.0);
  return std::nullopt;
}

void MapActor::Correct(const std::string& session, const std::string& request_id,
                       CorrectedTrajectory correction, CorrectionCallback done) {
  std::optional<absl::StatusOr<CorrectionAnswer>> at_once;
  {
    MutexLock lock(mutex_);
    at_once = AnswerAtOnceLocked(correction_book_, "corrections", session, request_id);
    if (!at_once.has_value()) {
      if (correction_book_.JoinOrOpen(session, request_id, done)) return;
      PendingSession& pending = pending_[session];
      pending.correction = std::move(correction);
      const Clock::time_point now = Clock::now();
      pending.waiters.push_back({session, request_id, now, std::move(done)});
      correction_arrivals_.insert(now);
      NoteNewsLocked();
      urgent_ = true;
      cancel_.Cancel();
      changed_.NotifyOne();
      return;
    }
  }
  done(*at_once);
}

void MapActor::Retract(const std::string& session, const std::string& request_id, bool restore,
                       RetractionCallback done) {
  std::optional<absl::StatusOr<RetractionAnswer>> at_once;
  {
    MutexLock lock(mutex_);
    at_once = AnswerAtOnceLocked(retraction_book_, "retractions", session, request_id);
    if (!at_once.has_value()) {
      if (retraction_book_.JoinOrOpen(session, request_id, done)) return;
      retractions_.push_back({session, request_id, restore, std::move(done)});
      NoteNewsLocked();
      urgent_ = true;
      changed_.NotifyOne();
      return;
    }
  }
  done(*at_once);
}

void MapActor::TakeState(StateCallback done) {
  absl::Status ended;
  {
    MutexLock lock(mutex_);
    ended = status_;
    if (ended.ok()) {
      states_.push_back(std::move(done));
      urgent_ = true;
      changed_.NotifyOne();
      return;
    }
  }
  done(ended);
}

MapActor::Lag MapActor::lag() const {
  MutexLock lock(mutex_);
  Lag lag;
  lag.published = published_at_;
  lag.oldest_waiting = taken_since_.has_value() ? taken_since_ : news_since_;
  if (!correction_arrivals_.empty()) lag.oldest_correction = *correction_arrivals_.begin();
  lag.num_corrections = correction_book_.num_waiting();
  return lag;
}

void MapActor::NoteNewsLocked() {
  if (!news_since_.has_value()) news_since_ = Clock::now();
}

std::optional<MapActor::SessionPage> MapActor::SessionsAfter(const std::string& after,
                                                             std::size_t count) const {
  MutexLock lock(mutex_);
  SessionPage page;
  if (!after.empty()) {
    const auto found = known_.find(after);
    if (found == known_.end()) return std::nullopt;
    page.first = found->second + 1;
  }
  const std::size_t end = std::min(page.first + count, sessions_.size());
  page.sessions.assign(sessions_.begin() + static_cast<std::ptrdiff_t>(page.first),
                       sessions_.begin() + static_cast<std::ptrdiff_t>(end));
  page.is_last = end == sessions_.size();
  return page;
}

MapActor::SessionPage MapActor::NewestSessions(std::size_t count) const {
  MutexLock lock(mutex_);
  SessionPage page;
  page.first = sessions_.size() - std::min(count, sessions_.size());
  page.sessions.assign(sessions_.begin() + static_cast<std::ptrdiff_t>(page.first),
                       sessions_.end());
  page.is_last = true;
  return page;
}

absl::Status MapActor::status() const {
  MutexLock lock(mutex_);
  return status_;
}

void MapActor::Stop() { End(absl::UnavailableError("the server is going away")); }

void MapActor::Delete() { End(Deleted(id_)); }

void MapActor::End(const absl::Status& why) {
  MutexLock lock(mutex_);
  if (status_.ok()) status_ = why;
  cancel_.Cancel();
  ending_.Cancel();
  changed_.NotifyAll();
  accepted_.NotifyAll();
}

void MapActor::Join() {
  if (thread_.joinable()) thread_.join();
}

void MapActor::Run() {
  NameThread("map");
  // Scans are due, corrections are only wanted soon. Rendering threads are started from here.
  RunBehindOthers();
  Batch batch;
  while (true) {
    const Waited waited = WaitForWork(batch, history_->Trim(Clock::now()));
    if (waited == Waited::kStopped) break;
    if (waited == Waited::kHistory) continue;
    Batch taken = std::exchange(batch, {});
    Apply(taken);
    // A stream of corrections faster than a rendering must not starve the readers.
    const bool may_restart = restarts_ < limits_.commit_restarts_max;
    CommitReport report;
    std::shared_ptr<const MapSnapshot> snapshot =
        mapper_->Commit(may_restart ? cancel_ : ending_, report);
    metrics_.ObserveCommit(report);
    last_commit_ = Clock::now();
    if (report.cancelled) {
      ++restarts_;
      continue;
    }
    restarts_ = 0;
    Publish(std::move(snapshot), report);
  }
  AbandonAll();
  if (absl::IsNotFound(status())) Free();
}

MapActor::Waited MapActor::WaitForWork(Batch& batch, std::optional<Clock::time_point> expiry) {
  const Clock::time_point next_commit = last_commit_ + PeriodOf(limits_.publish_hz);
  MutexLock lock(mutex_);
  while (status_.ok() && !urgent_ && restarts_ == 0) {
    const bool has_news = !added_.empty() || !pending_.empty() || !retractions_.empty();
    if (has_news && Clock::now() >= next_commit) break;
    if (has_news) {
      changed_.WaitUntil(mutex_, next_commit);
    } else if (!expiry.has_value()) {
      changed_.Wait(mutex_);
    } else if (!changed_.WaitUntil(mutex_, *expiry)) {
      return Waited::kHistory;
    }
  }
  if (!status_.ok()) return Waited::kStopped;
  batch.added = std::exchange(added_, {});
  batch.sessions = std::exchange(pending_, {});
  batch.retractions = std::exchange(retractions_, {});
  batch.states = std::exchange(states_, {});
  urgent_ = false;
  // A rendering that was stopped has published nothing of what it took.
  if (!taken_since_.has_value()) taken_since_ = news_since_;
  news_since_.reset();
  // Under the mutex: a correction that comes later raises it again.
  cancel_.Reset();
  accepted_.NotifyAll();
  return Waited::kWork;
}

void MapActor::Apply(Batch& batch) {
  for (const NewSession& added : batch.added)
    GEM_CHECK(mapper_->AddSession(added.session, added.robot, added.T_G_O).ok());
  for (auto& [session, pending] : batch.sessions) {
    if (pending.has_update) {
      const absl::Status status = mapper_->Update(session, std::move(pending.update));
      GEM_CHECK(status.ok());  // sessions are added before they update and end once
    }
    for (PublishedCallback& published : pending.published)
      unpublished_.published.push_back(std::move(published));
    if (!pending.correction.has_value()) continue;
    const absl::StatusOr<CorrectionCounts> counts =
        mapper_->Correct(session, *std::move(pending.correction));
    for (CorrectionWaiter& waiter : pending.waiters) {
      if (counts.ok()) {
        unpublished_.corrected.emplace_back(std::move(waiter), *counts);
      } else {
        Answer(waiter, wire::WithField(counts.status(), "poses"));
      }
    }
  }
  for (RetractionWaiter& waiter : batch.retractions) {
    const absl::StatusOr<RetractionCounts> counts =
        mapper_->Retract(waiter.session, waiter.restore);
    GEM_CHECK(counts.ok());  // the session is known
    unpublished_.retracted.emplace_back(std::move(waiter), *counts);
  }
  for (StateCallback& done : batch.states) unpublished_.states.push_back(std::move(done));
}

void MapActor::Publish(std::shared_ptr<const MapSnapshot> snapshot, const CommitReport& report) {
  const MapVersion version = snapshot->version;
  Unpublished published = std::exchange(unpublished_, {});
  const bool is_new = history_->newest()->version != version;
  history_->Publish(std::move(snapshot), Clock::now());
  {
    MutexLock lock(mutex_);
    if (is_new) published_at_ = Clock::now();
    taken_since_.reset();
  }
  for (const PublishedCallback& done : published.published) done(version);
  for (const auto& [waiter, counts] : published.corrected) {
    metrics_.ObserveCorrection(std::chrono::duration<double>(Clock::now() - waiter.arrived).count(),
                               report.num_touched_tiles);
    Answer(waiter, CorrectionAnswer{version, report.num_moved_submaps, report.num_touched_tiles,
                                    counts.num_ahead, counts.num_ignored});
  }
  for (const auto& [waiter, counts] : published.retracted)
    Answer(waiter, RetractionAnswer{version, counts, report.num_touched_tiles});
  if (published.states.empty()) return;
  const auto state = std::make_shared<const MapState>(mapper_->State());
  for (const StateCallback& done : published.states) done(state);
}

void MapActor::Answer(const CorrectionWaiter& waiter,
                      const absl::StatusOr<CorrectionAnswer>& answer) {
  std::vector<CorrectionCallback> repeats;
  {
    MutexLock lock(mutex_);
    repeats = correction_book_.Close(waiter.session, waiter.request_id, answer);
    const auto arrival = correction_arrivals_.find(waiter.arrived);
    if (arrival != correction_arrivals_.end()) correction_arrivals_.erase(arrival);
  }
  waiter.done(answer);
  for (const CorrectionCallback& done : repeats) done(answer);
}

void MapActor::Answer(const RetractionWaiter& waiter,
                      const absl::StatusOr<RetractionAnswer>& answer) {
  std::vector<RetractionCallback> repeats;
  {
    MutexLock lock(mutex_);
    repeats = retraction_book_.Close(waiter.session, waiter.request_id, answer);
  }
  waiter.done(answer);
  for (const RetractionCallback& done : repeats) done(answer);
}

void MapActor::AbandonAll() {
  Batch batch;
  absl::Status why;
  {
    MutexLock lock(mutex_);
    batch.sessions = std::exchange(pending_, {});
    batch.retractions = std::exchange(retractions_, {});
    batch.states = std::exchange(states_, {});
    why = status_;
  }
  for (auto& [session, pending] : batch.sessions) {
    for (PublishedCallback& published : pending.published)
      unpublished_.published.push_back(std::move(published));
    for (CorrectionWaiter& waiter : pending.waiters)
      unpublished_.corrected.emplace_back(std::move(waiter), CorrectionCounts{});
  }
  for (RetractionWaiter& waiter : batch.retractions)
    unpublished_.retracted.emplace_back(std::move(waiter), RetractionCounts{});
  for (StateCallback& done : batch.states) unpublished_.states.push_back(std::move(done));
  for (const PublishedCallback& done : unpublished_.published) done(why);
  for (const auto& [waiter, counts] : unpublished_.corrected) Answer(waiter, why);
  for (const auto& [waiter, counts] : unpublished_.retracted) Answer(waiter, why);
  for (const StateCallback& done : unpublished_.states) done(why);
  unpublished_ = {};
}

void MapActor::Free() {
  auto last = std::make_shared<MapSnapshot>();
  const MapVersion before = snapshot()->version;
  last->version = {before.epoch, before.revision + 1};
  last->options = options_;
  history_->End(std::move(last));
  mapper_.reset();
  MutexLock lock(mutex_);
  published_at_ = Clock::now();
}

}  // namespace gem
