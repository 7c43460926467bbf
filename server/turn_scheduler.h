// Gives streams their turns on the workers: when there is news, when a time has come, when their
// last message is on its way. Mappers leave word and go on; a stream that waits costs nothing.
#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <thread>
#include <utility>
#include <vector>

#include "absl/container/btree_set.h"
#include "absl/container/flat_hash_map.h"
#include "absl/container/flat_hash_set.h"
#include "absl/status/status.h"
#include "core/base/mutex.h"
#include "server/ingest_message.h"
#include "server/news.h"
#include "server/worker_pool.h"

namespace gem {

class TurnTaker {
 public:
  virtual ~TurnTaker() = default;
  /// A bit of work, on a worker; never two turns of one at once. Returns when the next turn is due
  /// if nothing wakes it before.
  virtual std::optional<Clock::time_point> TakeTurn(Clock::time_point now) = 0;
  /// The scheduler stops: no turn begins any more.
  virtual void OnStop() = 0;
  /// Since when it is behind with what it has to tell, if it is. Thread-safe.
  virtual std::optional<Clock::time_point> behind_since() const = 0;
};

/// Thread-safe.
class TurnScheduler final : public NewsListener {
 public:
  /// At most so many takers, and so many turns on the workers at once: calls that are answered once
  /// must not wait behind all streams.
  TurnScheduler(WorkerPool& pool, int takers_max, int turns_at_once);
  /// Waits for the last turns: the pool must still run, or have run all it took.
  ~TurnScheduler() override;
  TurnScheduler(const TurnScheduler&) = delete;
  TurnScheduler& operator=(const TurnScheduler&) = delete;

  /// Its first turn is due at once. RESOURCE_EXHAUSTED at the limit, UNAVAILABLE once stopped.
  absl::Status Add(const std::shared_ptr<TurnTaker>& taker, NewsSource source);
  /// No turn of it begins any more; the last one may still go on.
  void Remove(const TurnTaker* taker);
  /// A turn is due now.
  void Wake(const TurnTaker* taker);
  /// All takers of the source are due. Takes no longer for many of them.
  void OnNews(NewsSource source) override;

  /// Tells all takers; none can be added any more. The last turns may still go on.
  void Stop();

  std::vector<std::shared_ptr<TurnTaker>> takers() const;

 private:
  struct Seat {
    std::shared_ptr<TurnTaker> taker;
    NewsSource source{};
    enum class State : std::uint8_t { kWaits, kReady, kOnTurn } state = State::kWaits;
    bool due_again = false;                    ///< woken during its turn
    std::optional<Clock::time_point> wake_at;  ///< it is in alarms_
  };
  using Alarm = std::pair<Clock::time_point, const TurnTaker*>;

  void Run();
  void WakeLocked(const TurnTaker* taker) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void SetAlarmLocked(const TurnTaker* taker, Seat& seat, std::optional<Clock::time_point> at)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void WakeWhoIsDueLocked(Clock::time_point now) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  /// Gives turns while there is room; says when to try again if the workers take no more.
  std::optional<Clock::time_point> GiveTurnsLocked(Clock::time_point now)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void TakeTurn(const std::shared_ptr<TurnTaker>& taker);

  // Constant after construction.
  WorkerPool& pool_;
  const std::size_t takers_max_;
  const int turns_at_once_;

  mutable Mutex mutex_;
  CondVar changed_;
  absl::flat_hash_map<const TurnTaker*, Seat> seats_ ABSL_GUARDED_BY(mutex_);
  absl::flat_hash_map<NewsSource, absl::flat_hash_set<const TurnTaker*>> listeners_
      ABSL_GUARDED_BY(mutex_);
  absl::flat_hash_set<NewsSource> news_ ABSL_GUARDED_BY(mutex_);  ///< not passed on yet
  std::deque<const TurnTaker*> ready_ ABSL_GUARDED_BY(mutex_);    ///< who left is skipped
  absl::btree_set<Alarm> alarms_ ABSL_GUARDED_BY(mutex_);
  int num_turns_ ABSL_GUARDED_BY(mutex_) = 0;
  bool stopped_ ABSL_GUARDED_BY(mutex_) = false;

  std::thread thread_;
};

}  // namespace gem
