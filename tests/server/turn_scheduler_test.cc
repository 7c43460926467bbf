#include "server/turn_scheduler.h"

#include <gmock/gmock.h>

#include <atomic>
#include <functional>
#include <thread>

#include "server/retry.h"
#include "server/tile_watch.h"
#include "tests/server/made_maps.h"

namespace gem {
namespace {

/// Does what it is told on its turns, and can be waited for.
class Taker final : public TurnTaker {
 public:
  using Work = std::function<std::optional<Clock::time_point>(int turn)>;
  explicit Taker(Work work = nullptr) : work_(std::move(work)) {}

  std::optional<Clock::time_point> TakeTurn(Clock::time_point /*now*/) override {
    EXPECT_FALSE(on_turn_.exchange(true)) << "two turns at once";
    int turn = 0;
    {
      MutexLock lock(mutex_);
      turn = ++num_turns_;
    }
    const auto wake_at = work_ == nullptr ? std::nullopt : work_(turn);
    on_turn_ = false;
    MutexLock lock(mutex_);
    num_done_ = turn;
    changed_.NotifyAll();
    return wake_at;
  }
  void OnStop() override { stopped_ = true; }
  std::optional<Clock::time_point> behind_since() const override { return std::nullopt; }

  void WaitForTurns(int count) {
    MutexLock lock(mutex_);
    while (num_done_ < count) changed_.Wait(mutex_);
  }
  int num_turns() {
    MutexLock lock(mutex_);
    return num_done_;
  }
  bool stopped() const { return stopped_; }

 private:
  const Work work_;
  std::atomic<bool> on_turn_{false};
  std::atomic<bool> stopped_{false};
  Mutex mutex_;
  CondVar changed_;
  int num_turns_ ABSL_GUARDED_BY(mutex_) = 0;
  int num_done_ ABSL_GUARDED_BY(mutex_) = 0;
};

class Scheduling : public testing::Test {
 protected:
  WorkerPool pool_{2, 16};
  TurnScheduler scheduler_{pool_, 3, 2};
  const NewsSource news_ = NewNewsSource();
};

TEST_F(Scheduling, TheFirstTurnIsDueAtOnceThenComeNews) {
  const auto taker = std::make_shared<Taker>();
  ASSERT_TRUE(scheduler_.Add(taker, news_).ok());
  taker->WaitForTurns(1);
  scheduler_.OnNews(news_);
  taker->WaitForTurns(2);
  scheduler_.Wake(taker.get());
  taker->WaitForTurns(3);
}

TEST_F(Scheduling, NewsOfOthersWakeNobody) {
  const auto deaf = std::make_shared<Taker>();
  const auto taker = std::make_shared<Taker>();
  ASSERT_TRUE(scheduler_.Add(deaf, NewNewsSource()).ok());
  ASSERT_TRUE(scheduler_.Add(taker, news_).ok());
  deaf->WaitForTurns(1);
  taker->WaitForTurns(1);
  scheduler_.OnNews(news_);
  taker->WaitForTurns(2);
  EXPECT_EQ(deaf->num_turns(), 1);
}

TEST_F(Scheduling, WakesAtTheTimeThatATakerNames) {
  const auto taker = std::make_shared<Taker>(
      [](int turn) { return turn < 3 ? std::optional(Clock::now()) : std::nullopt; });
  ASSERT_TRUE(scheduler_.Add(taker, news_).ok());
  taker->WaitForTurns(3);
}

// A wake-up during a turn must not be lost: the turn may have looked just before.
TEST_F(Scheduling, WhoIsWokenDuringItsTurnGetsAnother) {
  std::atomic<bool> begun{false};
  std::atomic<bool> woken{false};
  const auto taker = std::make_shared<Taker>([&](int turn) -> std::optional<Clock::time_point> {
    begun = true;
    while (turn == 1 && !woken) std::this_thread::yield();
    return std::nullopt;
  });
  ASSERT_TRUE(scheduler_.Add(taker, news_).ok());
  while (!begun) std::this_thread::yield();
  scheduler_.Wake(taker.get());
  woken = true;
  taker->WaitForTurns(2);
}

TEST_F(Scheduling, HasALimitThatItNames) {
  std::vector<std::shared_ptr<Taker>> takers;
  for (int i = 0; i < 3; ++i) {
    takers.push_back(std::make_shared<Taker>());
    ASSERT_TRUE(scheduler_.Add(takers.back(), news_).ok());
  }
  const absl::Status refused = scheduler_.Add(std::make_shared<Taker>(), news_);
  EXPECT_EQ(refused.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(std::string(refused.message()), "3 streams read maps, want at most 3");
  EXPECT_TRUE(RetryAfterSeconds(refused).has_value());
  scheduler_.Remove(takers.front().get());
  EXPECT_TRUE(scheduler_.Add(std::make_shared<Taker>(), news_).ok());
}

TEST_F(Scheduling, TellsAllWhenItStops) {
  const auto taker = std::make_shared<Taker>();
  ASSERT_TRUE(scheduler_.Add(taker, news_).ok());
  scheduler_.Stop();
  EXPECT_TRUE(taker->stopped());
  EXPECT_EQ(scheduler_.Add(std::make_shared<Taker>(), news_).code(),
            absl::StatusCode::kUnavailable);
}

// Other work fills the workers' queue: turns wait and come.
TEST(SchedulingWithAFullPool, LosesNoTurn) {
  WorkerPool pool(1, 1);
  TurnScheduler scheduler(pool, 10, 2);
  std::atomic<bool> free{false};
  const auto block = [&] {
    while (!free) std::this_thread::yield();
  };
  ASSERT_TRUE(pool.Submit(block).ok());
  while (!pool.Submit(block).ok()) std::this_thread::yield();
  const auto taker = std::make_shared<Taker>();
  ASSERT_TRUE(scheduler.Add(taker, NewNewsSource()).ok());
  free = true;
  taker->WaitForTurns(1);
}

/// A reader that reads at random speed; knows when it has seen a version completely.
class Reader final : public TurnTaker {
 public:
  Reader(std::shared_ptr<const MapHistory> history, const TileWatchOptions& options)
      : watch_(std::move(history), options, Clock::now()) {}

  std::optional<Clock::time_point> TakeTurn(Clock::time_point now) override {
    class Nothing final : public TileSink {
      void Add(const Tile& /*tile*/) override { ++count_; }
      void AddAbsent(const TileAddress& /*address*/, const MapVersion& /*version*/) override {}
      std::size_t size_bytes() const override { return count_ * 30'000; }
      std::size_t count_ = 0;
    } sink;
    const TileWatch::Turn turn = watch_.TakeTurn(now, sink);
    if (turn.kind != TileWatch::Turn::Kind::kPart) return turn.wake_at;
    if (turn.complete) complete_ = turn.version.revision;
    return now;  // written at once
  }
  void OnStop() override {}
  std::optional<Clock::time_point> behind_since() const override { return watch_.behind_since(); }
  std::uint64_t complete() const { return complete_; }

 private:
  TileWatch watch_;
  std::atomic<std::uint64_t> complete_{0};
};

// For ThreadSanitizer, and for lost wake-ups: readers come and go while maps are published; those
// that stay have the last version in the end.
TEST(SchedulingWatches, EverybodyGetsTheLastVersion) {
  WorkerPool pool(2, 4);
  TurnScheduler scheduler(pool, 100, 2);
  test::MadeMaps maps;
  const auto history =
      std::make_shared<MapHistory>(maps.Current(), HistoryOptions{.listener = &scheduler});
  std::vector<std::shared_ptr<Reader>> readers;
  const auto add = [&](double min_interval_s) {
    readers.push_back(
        std::make_shared<Reader>(history, TileWatchOptions{.min_interval_s = min_interval_s}));
    ASSERT_TRUE(scheduler.Add(readers.back(), history->source()).ok());
  };
  for (int i = 0; i < 10; ++i) add(i % 3 == 0 ? 0.001 : 0);
  constexpr std::uint64_t kRevisions = 300;
  for (std::uint64_t i = 0; i < kRevisions; ++i) {
    history->Publish(maps.Next({{static_cast<std::int32_t>(i % 7), 0}}), Clock::now());
    if (i % 10 != 0) continue;
    scheduler.Remove(readers.front().get());
    readers.erase(readers.begin());
    add(0);
  }
  for (const auto& reader : readers) {
    while (reader->complete() < kRevisions) std::this_thread::yield();
    EXPECT_EQ(reader->behind_since(), std::nullopt);
  }
}

}  // namespace
}  // namespace gem
