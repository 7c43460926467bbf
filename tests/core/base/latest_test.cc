#include "core/base/latest.h"

#include <gtest/gtest.h>

#include <atomic>
#include <cstdint>
#include <thread>
#include <vector>

namespace gem {
namespace {

TEST(Latest, IsNullBeforeTheFirst) {
  Latest<int> latest;
  EXPECT_EQ(latest.Get(), nullptr);
  latest.Set(std::make_shared<const int>(7));
  EXPECT_EQ(*latest.Get(), 7);
}

// A value that nobody holds any more must not be kept alive: maps are large.
TEST(Latest, KeepsNoOlderValue) {
  Latest<int> latest;
  const auto first = std::make_shared<const int>(1);
  latest.Set(first);
  latest.Set(std::make_shared<const int>(2));
  EXPECT_EQ(first.use_count(), 1);
}

// Under ThreadSanitizer, too: a slot that is written while it is copied would be a race.
TEST(Latest, ReadersSeeWholeValuesInOrder) {
  struct Pair {
    std::uint64_t a, b;
  };
  Latest<Pair> latest;
  latest.Set(std::make_shared<const Pair>(Pair{0, 0}));
  std::atomic<bool> done{false};
  std::vector<std::thread> readers;
  for (int i = 0; i < 3; ++i)
    readers.emplace_back([&] {
      std::uint64_t newest = 0;
      while (!done.load()) {
        const std::shared_ptr<const Pair> pair = latest.Get();
        EXPECT_EQ(pair->a, pair->b);
        EXPECT_GE(pair->a, newest);
        newest = pair->a;
      }
    });
  for (std::uint64_t i = 1; i <= 20'000; ++i) latest.Set(std::make_shared<const Pair>(Pair{i, i}));
  done.store(true);
  for (std::thread& reader : readers) reader.join();
  EXPECT_EQ(latest.Get()->a, 20'000u);
}

}  // namespace
}  // namespace gem
