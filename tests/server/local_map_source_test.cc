#include "server/local_map_source.h"

#include <gtest/gtest.h>

#include "tests/server/made_maps.h"

namespace gem {
namespace {

using test::AtSeconds;

std::shared_ptr<const LocalMap> MapOfScan(std::uint64_t seq) {
  auto map = std::make_shared<LocalMap>();
  map->seq = seq;
  map->side_cells = 2;
  map->cell_size_m = 0.5f;
  map->ResizeLayers(4);
  map->state[0] = kCellKnown;
  return map;
}

class LocalMaps : public testing::Test {
 protected:
  std::unique_ptr<LocalMapSource> Watch(double min_interval_s = 0) {
    return std::make_unique<LocalMapSource>(feed_, wire::CellSelection{{Layer::kElevation}},
                                            min_interval_s, cache_, metrics_);
  }

  EncodedCache cache_{1 << 20};
  Metrics metrics_;
  const std::shared_ptr<LocalMapFeed> feed_ = std::make_shared<LocalMapFeed>(nullptr);
  const std::uint64_t ticket_ = feed_->Begin({"s1", {}, {}});
};

TEST_F(LocalMaps, ComeOnceEachTheNewestAlways) {
  const auto watch = Watch();
  EXPECT_FALSE(watch->TakeNext(AtSeconds(0)).message.has_value());
  EXPECT_EQ(watch->behind_since(), std::nullopt);
  feed_->Publish(ticket_, MapOfScan(1));
  EXPECT_TRUE(watch->behind_since().has_value());
  EXPECT_TRUE(watch->TakeNext(AtSeconds(0)).message.has_value());
  EXPECT_FALSE(watch->TakeNext(AtSeconds(0)).message.has_value());
  EXPECT_EQ(watch->behind_since(), std::nullopt);
  for (std::uint64_t seq = 2; seq <= 5; ++seq) feed_->Publish(ticket_, MapOfScan(seq));
  EXPECT_TRUE(watch->TakeNext(AtSeconds(0)).message.has_value());
  EXPECT_FALSE(watch->TakeNext(AtSeconds(0)).message.has_value());
}

TEST_F(LocalMaps, WaitForTheIntervalThatWasAskedFor) {
  const auto watch = Watch(10);
  feed_->Publish(ticket_, MapOfScan(1));
  EXPECT_TRUE(watch->TakeNext(AtSeconds(1)).message.has_value());
  feed_->Publish(ticket_, MapOfScan(2));
  const MessageSource::Next wait = watch->TakeNext(AtSeconds(5));
  EXPECT_FALSE(wait.message.has_value());
  EXPECT_EQ(wait.wake_at, AtSeconds(11));
  EXPECT_TRUE(watch->TakeNext(AtSeconds(11)).message.has_value());
}

TEST_F(LocalMaps, AreEncodedOnceForAllWhoWantTheSame) {
  const auto first = Watch();
  const auto second = Watch();
  feed_->Publish(ticket_, MapOfScan(1));
  first->TakeNext(AtSeconds(0));
  second->TakeNext(AtSeconds(0));
  EXPECT_EQ(cache_.stats().num_misses, 1u);
  EXPECT_EQ(cache_.stats().num_hits, 1u);
}

TEST_F(LocalMaps, GoOnWithTheNextSessionAndOnlyWithIt) {
  const auto watch = Watch();
  feed_->Publish(ticket_, MapOfScan(7));
  watch->TakeNext(AtSeconds(0));
  const std::uint64_t next = feed_->Begin({"s2", {}, {}});
  EXPECT_EQ(feed_->newest().map, nullptr);
  feed_->Publish(ticket_, MapOfScan(8));
  EXPECT_FALSE(watch->TakeNext(AtSeconds(0)).message.has_value());
  feed_->Publish(next, MapOfScan(1));
  EXPECT_TRUE(watch->TakeNext(AtSeconds(0)).message.has_value());
  EXPECT_EQ(feed_->newest().origin->session, "s2");
}

}  // namespace
}  // namespace gem
