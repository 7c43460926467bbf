#include "core/base/parallel_for.h"

#include <gtest/gtest.h>

#include <atomic>
#include <mutex>
#include <set>
#include <thread>
#include <vector>

#include "core/base/cancel_token.h"

namespace gem {
namespace {

TEST(ParallelFor, DoesEachPieceOnce) {
  for (const int threads : {-1, 0, 1, 2, 7}) {
    std::vector<std::atomic<int>> done(1000);
    ParallelFor(done.size(), threads, [&](std::size_t i) { ++done[i]; });
    for (const std::atomic<int>& times : done) ASSERT_EQ(times, 1);
  }
}

TEST(ParallelFor, ReturnsWhenAllIsDone) {
  std::vector<int> squares(500);
  ParallelFor(squares.size(), 4,
              [&](std::size_t i) { squares[i] = static_cast<int>(i) * static_cast<int>(i); });
  EXPECT_EQ(squares[499], 499 * 499);
}

TEST(ParallelFor, WithoutWorkDoesNothing) {
  ParallelFor(0, 4, [](std::size_t) { FAIL(); });
}

TEST(ParallelFor, OneThreadIsTheCallersOwn) {
  std::set<std::thread::id> ids;
  ParallelFor(10, 1, [&](std::size_t) { ids.insert(std::this_thread::get_id()); });
  EXPECT_EQ(ids, std::set<std::thread::id>{std::this_thread::get_id()});
}

TEST(ParallelFor, UsesNoMoreThreadsThanAllowed) {
  std::mutex mutex;
  std::set<std::thread::id> ids;
  ParallelFor(1000, 3, [&](std::size_t) {
    const std::lock_guard<std::mutex> lock(mutex);
    ids.insert(std::this_thread::get_id());
  });
  EXPECT_LE(ids.size(), 3u);
}

TEST(CancelToken, StaysRaisedUntilReset) {
  CancelToken token;
  EXPECT_FALSE(token.cancelled());
  token.Cancel();
  token.Cancel();
  EXPECT_TRUE(token.cancelled());
  token.Reset();
  EXPECT_FALSE(token.cancelled());
}

}  // namespace
}  // namespace gem
