#include "server/encoded_cache.h"

#include <gmock/gmock.h>

#include <atomic>
#include <thread>

namespace gem {
namespace {

EncodedKey KeyOf(std::uint64_t revision) {
  EncodedKey key;
  key.revision = revision;
  return key;
}

wire::EncodedCells Bytes(std::size_t count) { return {std::string(count, 'x'), count}; }

TEST(EncodedCache, EncodesOnce) {
  EncodedCache cache(1 << 20);
  int num_encoded = 0;
  const auto encode = [&] {
    ++num_encoded;
    return Bytes(10);
  };
  const EncodedCache::Encoded first = cache.Get(KeyOf(1), encode);
  EXPECT_EQ(first->bytes.size(), 10u);
  EXPECT_EQ(cache.Get(KeyOf(1), encode), first);
  EXPECT_EQ(num_encoded, 1);
  EXPECT_EQ(cache.stats().num_hits, 1u);
  EXPECT_EQ(cache.stats().num_misses, 1u);
}

TEST(EncodedCache, WhateverTheBytesDependOnTellsEntriesApart) {
  EncodedCache cache(1 << 20);
  std::vector<EncodedKey> keys(8);
  keys[1].source = NewNewsSource();
  keys[2].revision = 1;
  keys[3].address.level = 1;
  keys[4].address.index.x = 1;
  keys[5].address.index.y = 1;
  keys[6].layers = 1;
  keys[7].encoding = wire::CellEncoding::kCompact;
  for (const EncodedKey& key : keys) cache.Get(key, [] { return Bytes(1); });
  EXPECT_EQ(cache.stats().num_misses, keys.size());
}

TEST(EncodedCache, DropsWhatWasUsedLongestAgo) {
  // Room for two entries of 1000 bytes and their books.
  EncodedCache cache(2800);
  const auto encode = [] { return Bytes(1000); };
  cache.Get(KeyOf(1), encode);
  cache.Get(KeyOf(2), encode);
  cache.Get(KeyOf(1), encode);
  cache.Get(KeyOf(3), encode);
  EXPECT_EQ(cache.stats().num_evicted, 1u);
  EXPECT_LE(cache.stats().bytes, 2800u);
  const std::uint64_t misses = cache.stats().num_misses;
  cache.Get(KeyOf(1), encode);
  EXPECT_EQ(cache.stats().num_misses, misses);
  cache.Get(KeyOf(2), encode);
  EXPECT_EQ(cache.stats().num_misses, misses + 1);
}

TEST(EncodedCache, WhatDoesNotFitIsGivenAndNotKept) {
  EncodedCache cache(500);
  EXPECT_EQ(cache.Get(KeyOf(1), [] { return Bytes(1000); })->bytes.size(), 1000u);
  EXPECT_EQ(cache.stats().bytes, 0u);
  EXPECT_EQ(cache.stats().num_evicted, 0u);
}

TEST(EncodedCache, ThreadsThatWantTheSameWaitForOneThatEncodes) {
  EncodedCache cache(1 << 20);
  std::atomic<int> num_encoded{0};
  std::atomic<int> num_asking{0};
  std::vector<std::thread> threads;
  for (int i = 0; i < 8; ++i)
    threads.emplace_back([&] {
      ++num_asking;
      const auto encoded = cache.Get(KeyOf(1), [&] {
        // All others ask meanwhile.
        while (num_asking.load() < 8) std::this_thread::yield();
        ++num_encoded;
        return Bytes(7);
      });
      EXPECT_EQ(encoded->bytes.size(), 7u);
    });
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(num_encoded.load(), 1);
  EXPECT_EQ(cache.stats().num_hits, 7u);
}

TEST(EncodedCache, StaysWithinItsBoundsUnderManyThreads) {
  EncodedCache cache(20'000);
  std::vector<std::thread> threads;
  for (std::uint64_t t = 0; t < 4; ++t)
    threads.emplace_back([&, t] {
      for (std::uint64_t i = 0; i < 2000; ++i) {
        const std::uint64_t revision = (i * (t + 1)) % 37;
        const auto encoded = cache.Get(KeyOf(revision), [&] { return Bytes(100 * revision); });
        EXPECT_EQ(encoded->bytes.size(), 100 * revision);
      }
    });
  for (std::thread& thread : threads) thread.join();
  const EncodedCache::Stats stats = cache.stats();
  EXPECT_LE(stats.bytes, 20'000u);
  EXPECT_EQ(stats.num_hits + stats.num_misses, 8000u);
}

}  // namespace
}  // namespace gem
