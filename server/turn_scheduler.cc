#include "server/turn_scheduler.h"

#include "absl/strings/str_cat.h"
#include "server/retry.h"

namespace gem {
namespace {

constexpr double kRetryAfter_s = 5;
/// While the workers' queue is full.
constexpr std::chrono::milliseconds kPoolPause(5);

}  // namespace

TurnScheduler::TurnScheduler(WorkerPool& pool, int takers_max, int turns_at_once)
    : pool_(pool),
      takers_max_(static_cast<std::size_t>(takers_max)),
      turns_at_once_(turns_at_once),
      thread_([this] { Run(); }) {}

TurnScheduler::~TurnScheduler() {
  Stop();
  thread_.join();
  MutexLock lock(mutex_);
  while (num_turns_ > 0) changed_.Wait(mutex_);
}

absl::Status TurnScheduler::Add(const std::shared_ptr<TurnTaker>& taker, NewsSource source) {
  MutexLock lock(mutex_);
  if (stopped_) return absl::UnavailableError("the server is going away");
  if (seats_.size() >= takers_max_)
    return WithRetry(absl::ResourceExhaustedError(absl::StrCat(
                         seats_.size(), " streams read maps, want at most ", takers_max_)),
                     kRetryAfter_s);
  seats_[taker.get()] = {taker, source, Seat::State::kWaits, false, std::nullopt};
  listeners_[source].insert(taker.get());
  WakeLocked(taker.get());
  return absl::OkStatus();
}

void TurnScheduler::Remove(const TurnTaker* taker) {
  std::shared_ptr<TurnTaker> removed;  // may be the last reference: not under the lock
  MutexLock lock(mutex_);
  const auto seat = seats_.find(taker);
  if (seat == seats_.end()) return;
  SetAlarmLocked(taker, seat->second, std::nullopt);
  const auto listeners = listeners_.find(seat->second.source);
  listeners->second.erase(taker);
  if (listeners->second.empty()) listeners_.erase(listeners);
  removed = std::move(seat->second.taker);
  seats_.erase(seat);
}

void TurnScheduler::Wake(const TurnTaker* taker) {
  MutexLock lock(mutex_);
  WakeLocked(taker);
}

void TurnScheduler::OnNews(NewsSource source) {
  MutexLock lock(mutex_);
  if (!listeners_.contains(source)) return;
  news_.insert(source);
  changed_.NotifyOne();
}

void TurnScheduler::Stop() {
  absl::flat_hash_map<const TurnTaker*, Seat> seats;
  {
    MutexLock lock(mutex_);
    stopped_ = true;
    changed_.NotifyOne();
    seats = seats_;
  }
  for (const auto& [taker, seat] : seats) seat.taker->OnStop();
}

std::vector<std::shared_ptr<TurnTaker>> TurnScheduler::takers() const {
  MutexLock lock(mutex_);
  std::vector<std::shared_ptr<TurnTaker>> takers;
  takers.reserve(seats_.size());
  for (const auto& [taker, seat] : seats_) takers.push_back(seat.taker);
  return takers;
}

void TurnScheduler::Run() {
  MutexLock lock(mutex_);
  while (!stopped_) {
    const Clock::time_point now = Clock::now();
    WakeWhoIsDueLocked(now);
    const std::optional<Clock::time_point> retry = GiveTurnsLocked(now);
    if (retry.has_value() && (alarms_.empty() || *retry < alarms_.begin()->first)) {
      changed_.WaitUntil(mutex_, *retry);
    } else if (!alarms_.empty()) {
      changed_.WaitUntil(mutex_, alarms_.begin()->first);
    } else {
      changed_.Wait(mutex_);
    }
  }
}

void TurnScheduler::WakeLocked(const TurnTaker* taker) {
  const auto found = seats_.find(taker);
  if (found == seats_.end()) return;
  Seat& seat = found->second;
  switch (seat.state) {
    case Seat::State::kWaits:
      SetAlarmLocked(taker, seat, std::nullopt);
      seat.state = Seat::State::kReady;
      ready_.push_back(taker);
      changed_.NotifyOne();
      break;
    case Seat::State::kReady:
      break;
    case Seat::State::kOnTurn:
      seat.due_again = true;
      break;
  }
}

void TurnScheduler::SetAlarmLocked(const TurnTaker* taker, Seat& seat,
                                   std::optional<Clock::time_point> at) {
  if (seat.wake_at.has_value()) alarms_.erase({*seat.wake_at, taker});
  seat.wake_at = at;
  if (at.has_value()) alarms_.insert({*at, taker});
}

void TurnScheduler::WakeWhoIsDueLocked(Clock::time_point now) {
  for (const NewsSource source : news_) {
    const auto listeners = listeners_.find(source);
    if (listeners == listeners_.end()) continue;
    for (const TurnTaker* taker : listeners->second) WakeLocked(taker);
  }
  news_.clear();
  while (!alarms_.empty() && alarms_.begin()->first <= now) WakeLocked(alarms_.begin()->second);
}

std::optional<Clock::time_point> TurnScheduler::GiveTurnsLocked(Clock::time_point now) {
  while (!ready_.empty() && num_turns_ < turns_at_once_) {
    const auto found = seats_.find(ready_.front());
    if (found != seats_.end() && found->second.state == Seat::State::kReady) {
      const absl::Status given =
          pool_.Submit([this, taker = found->second.taker] { TakeTurn(taker); });
      if (!given.ok()) return now + kPoolPause;
      found->second.state = Seat::State::kOnTurn;
      ++num_turns_;
    }
    ready_.pop_front();
  }
  return std::nullopt;
}

void TurnScheduler::TakeTurn(const std::shared_ptr<TurnTaker>& taker) {
  bool has_left = false;
  {
    MutexLock lock(mutex_);
    has_left = stopped_ || !seats_.contains(taker.get());
  }
  std::optional<Clock::time_point> wake_at;
  if (!has_left) wake_at = taker->TakeTurn(Clock::now());
  MutexLock lock(mutex_);
  --num_turns_;
  changed_.NotifyOne();
  const auto found = seats_.find(taker.get());
  if (found == seats_.end()) return;
  Seat& seat = found->second;
  seat.state = Seat::State::kWaits;
  if (std::exchange(seat.due_again, false)) {
    WakeLocked(taker.get());
  } else {
    SetAlarmLocked(taker.get(), seat, wake_at);
  }
}

}  // namespace gem
