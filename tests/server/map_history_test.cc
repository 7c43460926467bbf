#include "server/map_history.h"

#include <gmock/gmock.h>

#include <thread>

#include "proto/wire/refusal.h"
#include "server/error_reason.h"
#include "tests/server/made_maps.h"

namespace gem {
namespace {

using test::AtSeconds;
using test::kEpoch;
using testing::ElementsAre;
using testing::IsEmpty;
using testing::UnorderedElementsAre;

/// Bytes of a tile's cells.
constexpr std::uint64_t kTileBytes = kTileCells * kTileCells * sizeof(CellBelief);

class History : public testing::Test {
 protected:
  explicit History(const HistoryOptions& options = {}) : history_(maps_.Current(), options) {}

  void Publish(double now_s, const std::vector<TileIndex>& changed,
               const std::vector<TileIndex>& gone = {}) {
    history_.Publish(maps_.Next(changed, gone), AtSeconds(now_s));
    history_.Trim(AtSeconds(now_s));
  }
  absl::Status StatusAt(MapVersion version, double now_s) const {
    return history_.At(version, AtSeconds(now_s)).status();
  }
  std::vector<TileIndex> ChangesAfter(std::uint64_t revision) const {
    const TileChanges changes = history_.ChangesAfter(MapVersion{kEpoch, revision}, 0, {});
    EXPECT_FALSE(changes.reset) << revision;
    return changes.tiles;
  }

  test::MadeMaps maps_;
  MapHistory history_;
};

TEST_F(History, KeepsARevisionForAWhileAfterItIsReplaced) {
  Publish(0, {{0, 0}});
  Publish(100, {{0, 0}});
  // Revision 1 was the newest until 100 s: it can be read until 130 s.
  const auto first = history_.At({kEpoch, 1}, AtSeconds(129.9));
  ASSERT_TRUE(first.ok()) << first.status();
  EXPECT_EQ((*first)->version.revision, 1u);
  EXPECT_EQ((*history_.At({kEpoch, 2}, AtSeconds(1e6)))->version.revision, 2u);
  const absl::Status expired = StatusAt({kEpoch, 1}, 130);
  EXPECT_EQ(expired.code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_EQ(ErrorReasonOf(expired), "REVISION_EXPIRED");
  EXPECT_EQ(wire::FieldOf(expired), "at");
  EXPECT_EQ(expired.message(),
            "at is revision 1 of epoch 7, which is not kept, want one that was the newest in the "
            "last 30 s; the newest is revision 2 of epoch 7");
}

TEST_F(History, ForgetsWithoutANewRevisionToo) {
  Publish(0, {{0, 0}});
  Publish(100, {{0, 0}});
  EXPECT_EQ(history_.num_replaced(), 1);
  EXPECT_EQ(history_.Trim(AtSeconds(129)), AtSeconds(130));
  EXPECT_EQ(history_.num_replaced(), 1);
  EXPECT_EQ(history_.Trim(AtSeconds(130)), std::nullopt);
  EXPECT_EQ(history_.num_replaced(), 0);
  EXPECT_EQ(history_.bytes(), 0u);
}

TEST_F(History, TellsTheOldFromTheForeignAndTheFuture) {
  Publish(0, {{0, 0}});
  EXPECT_EQ(ErrorReasonOf(StatusAt({8, 1}, 0)), "REVISION_EXPIRED");
  const absl::Status future = StatusAt({kEpoch, 2}, 0);
  EXPECT_EQ(future.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(future.message(), "at.revision is 2, want at most 1, which is the newest");
}

TEST_F(History, CountsOnlyWhatNoLaterRevisionHolds) {
  std::vector<TileIndex> tiles;
  for (std::int32_t x = 0; x < 100; ++x) tiles.push_back({x, 0});
  Publish(0, tiles);
  const std::uint64_t before = history_.bytes();
  for (int i = 0; i < 10; ++i) Publish(1, {{0, 0}});
  // Ten revisions hold one tile each; their books of 100 tiles are counted, too.
  EXPECT_GE(history_.bytes() - before, 10 * kTileBytes);
  EXPECT_LT(history_.bytes() - before, 11 * kTileBytes);
}

class NarrowHistory : public History {
 protected:
  NarrowHistory()
      : History({.retention_s = 30, .bytes_max = 5 * kTileBytes, .tombstones_max = 3}) {}
};

// A hundred corrections of the whole map in a second must not eat the memory.
TEST_F(NarrowHistory, ForgetsTheOldestEarlyWhenThereAreTooManyBytes) {
  const std::vector<TileIndex> tiles = {{0, 0}, {1, 0}};
  for (int i = 0; i < 100; ++i) {
    Publish(1, tiles);
    EXPECT_LE(history_.bytes(), 5 * kTileBytes);
  }
  EXPECT_EQ(history_.num_replaced(), 2);
  EXPECT_TRUE(StatusAt({kEpoch, 98}, 1).ok());
  EXPECT_EQ(ErrorReasonOf(StatusAt({kEpoch, 97}, 1)), "REVISION_EXPIRED");
}

TEST_F(History, RemembersWhenTheFirstNewsCame) {
  EXPECT_EQ(history_.FirstNewsAfter(0), std::nullopt);
  Publish(10, {{0, 0}});
  Publish(50, {{0, 0}});
  EXPECT_EQ(history_.FirstNewsAfter(0), AtSeconds(10));
  EXPECT_EQ(history_.FirstNewsAfter(1), AtSeconds(50));
  EXPECT_EQ(history_.FirstNewsAfter(2), std::nullopt);
}

TEST_F(History, CountsReadsThatCameTooLate) {
  Publish(0, {{0, 0}});
  Publish(100, {{0, 0}});
  EXPECT_EQ(history_.Find({kEpoch, 1}, AtSeconds(200)), nullptr);
  EXPECT_EQ(history_.num_expired_reads(), 0u);
  EXPECT_FALSE(StatusAt({kEpoch, 1}, 200).ok());
  EXPECT_EQ(history_.num_expired_reads(), 1u);
}

TEST_F(History, LevelsOfThePyramidAreKeptApart) {
  history_.Publish(maps_.Next({{0, 0}, {1, 0}}, {}, 2), AtSeconds(0));
  history_.Publish(maps_.Next({}, {{1, 0}}, 2), AtSeconds(0));
  EXPECT_THAT(history_.ChangesAfter(MapVersion{kEpoch, 1}, 2, {}).tiles,
              ElementsAre(TileIndex{1, 0}));
  EXPECT_THAT(history_.ChangesAfter(MapVersion{kEpoch, 0}, 1, {}).tiles, IsEmpty());
}

class Counter final : public NewsListener {
 public:
  void OnNews(NewsSource source) override { sources.push_back(source); }
  std::vector<NewsSource> sources;
};

TEST(HistoryNews, ComesWithEveryRevisionAndWithTheEndOfTheMap) {
  Counter counter;
  test::MadeMaps maps;
  MapHistory history(maps.Current(), {.listener = &counter});
  history.Publish(maps.Current(), AtSeconds(0));
  EXPECT_THAT(counter.sources, IsEmpty());
  history.Publish(maps.Next({{0, 0}}), AtSeconds(0));
  EXPECT_THAT(counter.sources, ElementsAre(history.source()));
  history.End(maps.Next({}));
  EXPECT_TRUE(history.ended());
  EXPECT_EQ(counter.sources.size(), 2u);
}

TEST_F(History, ListsWhatChangedAfterARevisionThatIsLongGone) {
  Publish(0, {{0, 0}, {1, 0}, {2, 0}});
  Publish(100, {{1, 0}});
  Publish(200, {{3, 0}}, {{2, 0}});
  EXPECT_EQ(history_.num_replaced(), 1);
  EXPECT_THAT(ChangesAfter(0), UnorderedElementsAre(TileIndex{0, 0}, TileIndex{1, 0},
                                                    TileIndex{2, 0}, TileIndex{3, 0}));
  EXPECT_THAT(ChangesAfter(1),
              UnorderedElementsAre(TileIndex{1, 0}, TileIndex{2, 0}, TileIndex{3, 0}));
  EXPECT_THAT(ChangesAfter(2), UnorderedElementsAre(TileIndex{2, 0}, TileIndex{3, 0}));
  EXPECT_THAT(ChangesAfter(3), IsEmpty());
}

TEST_F(History, ATileThatCameBackIsAChangeAndNoRemoval) {
  Publish(0, {{0, 0}});
  Publish(1, {}, {{0, 0}});
  Publish(2, {{0, 0}});
  EXPECT_THAT(ChangesAfter(1), ElementsAre(TileIndex{0, 0}));
  EXPECT_THAT(ChangesAfter(3), IsEmpty());
}

TEST_F(History, OnlyTilesOfTheRegionCount) {
  Publish(0, {{0, 0}, {1, 0}, {2, 0}});
  Publish(1, {{5, 5}}, {{2, 0}, {0, 0}});
  // Smaller than the map and larger than it: both ways of looking.
  for (const TileRange& rect : {TileRange{{0, 0}, {2, 1}}, TileRange{{-1000, -1000}, {2, 2}}}) {
    const TileChanges all = history_.ChangesAfter(std::nullopt, 0, rect);
    EXPECT_TRUE(all.reset);
    EXPECT_THAT(all.tiles, ElementsAre(TileIndex{1, 0}));
    EXPECT_THAT(history_.ChangesAfter(MapVersion{kEpoch, 1}, 0, rect).tiles,
                ElementsAre(TileIndex{0, 0}));
  }
}

TEST_F(History, StartsAnewForForeignVersions) {
  Publish(0, {{0, 0}});
  EXPECT_TRUE(history_.ChangesAfter(MapVersion{8, 1}, 0, {}).reset);
  EXPECT_TRUE(history_.ChangesAfter(MapVersion{kEpoch, 2}, 0, {}).reset);
  EXPECT_FALSE(history_.ChangesAfter(MapVersion{kEpoch, 1}, 0, {}).reset);
}

// Removals are remembered down to a floor; who is below it starts anew instead of keeping what
// went.
TEST_F(NarrowHistory, StartsAnewBelowTheFloorOfRemovals) {
  Publish(0, {{0, 0}, {1, 0}, {2, 0}, {3, 0}});  // revision 1
  for (std::int32_t x = 0; x < 4; ++x) Publish(0, {}, {{x, 0}});
  // The fourth removal, revision 5, is one too many: those of revisions 2 to 4 are forgotten.
  EXPECT_TRUE(history_.ChangesAfter(MapVersion{kEpoch, 3}, 0, {}).reset);
  EXPECT_THAT(ChangesAfter(4), ElementsAre(TileIndex{3, 0}));
}

// For ThreadSanitizer: readers while revisions come and go.
TEST_F(NarrowHistory, CanBeReadWhileItIsWritten) {
  std::thread writer([this] {
    for (int i = 0; i < 200; ++i) Publish(1, {{i % 3, 0}}, {{(i + 1) % 3, 0}});
  });
  std::uint64_t last = 0;
  while (last < 200) {
    const TileChanges changes = history_.ChangesAfter(MapVersion{kEpoch, last}, 0, {});
    EXPECT_GE(changes.snapshot->version.revision, last);
    last = changes.snapshot->version.revision;
    const auto snapshot = history_.At(changes.snapshot->version, AtSeconds(1));
    if (!snapshot.ok()) continue;
    EXPECT_EQ((*snapshot)->version.revision, last);
  }
  writer.join();
}

}  // namespace
}  // namespace gem
