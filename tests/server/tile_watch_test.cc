#include "server/tile_watch.h"

#include <gmock/gmock.h>

#include <random>

#include "absl/container/flat_hash_map.h"
#include "absl/container/flat_hash_set.h"
#include "server/error_reason.h"
#include "tests/server/made_maps.h"

namespace gem {
namespace {

using test::AtSeconds;
using test::kEpoch;
using testing::ElementsAre;
using testing::IsEmpty;
using Kind = TileWatch::Turn::Kind;

/// Takes note of tiles, each of which has so many bytes.
class Notebook final : public TileSink {
 public:
  explicit Notebook(std::size_t tile_bytes = 1000) : tile_bytes_(tile_bytes) {}
  void Add(const Tile& tile) override {
    tiles.push_back(tile.index);
    revisions.push_back(tile.version.revision);
    EXPECT_LE(tile.version.revision, newest_max);
  }
  void AddAbsent(const TileAddress& address, const MapVersion& /*version*/) override {
    absent.push_back(address.index);
  }
  std::size_t size_bytes() const override {
    return tiles.size() * tile_bytes_ + absent.size() * 30;
  }

  std::vector<TileIndex> tiles;
  std::vector<std::uint64_t> revisions;
  std::vector<TileIndex> absent;
  std::uint64_t newest_max = ~std::uint64_t{0};

 private:
  const std::size_t tile_bytes_;
};

class Watching : public testing::Test {
 protected:
  explicit Watching(const HistoryOptions& options = {})
      : history_(std::make_shared<MapHistory>(maps_.Current(), options)) {}

  void Publish(const std::vector<TileIndex>& changed, const std::vector<TileIndex>& gone = {},
               double now_s = 0) {
    history_->Publish(maps_.Next(changed, gone), AtSeconds(now_s));
    history_->Trim(AtSeconds(now_s));
  }
  TileWatch::Turn Take(TileWatch& watch, Notebook& notebook, double now_s = 0) {
    return watch.TakeTurn(AtSeconds(now_s), notebook);
  }
  /// Turns until there is nothing to do, all tiles in one notebook.
  TileWatch::Turn TakeAll(TileWatch& watch, Notebook& notebook, double now_s = 0) {
    TileWatch::Turn last;
    while (true) {
      Notebook part;
      const TileWatch::Turn turn = Take(watch, part, now_s);
      if (turn.kind != Kind::kPart) return last;
      last = turn;
      notebook.tiles.insert(notebook.tiles.end(), part.tiles.begin(), part.tiles.end());
      notebook.absent.insert(notebook.absent.end(), part.absent.begin(), part.absent.end());
    }
  }

  test::MadeMaps maps_;
  std::shared_ptr<MapHistory> history_;
};

TEST_F(Watching, BeginsWithEverythingNearestFirst) {
  Publish({{0, 0}, {3, 0}, {1, 0}});
  TileWatch watch(history_, {.region = Region{0, 0, 1000, 10}, .nearest_to = Place{10, 0}},
                  AtSeconds(0));
  Notebook notebook;
  const TileWatch::Turn turn = Take(watch, notebook);
  ASSERT_EQ(turn.kind, Kind::kPart);
  EXPECT_THAT(notebook.tiles, ElementsAre(TileIndex{0, 0}, TileIndex{1, 0}, TileIndex{3, 0}));
  EXPECT_TRUE(turn.reset);
  EXPECT_TRUE(turn.complete);
  EXPECT_EQ(turn.base, std::nullopt);
  EXPECT_EQ(turn.version, (MapVersion{kEpoch, 1}));
  EXPECT_EQ(turn.num_versions_skipped, 0u);
  Notebook nothing;
  const TileWatch::Turn wait = Take(watch, nothing);
  EXPECT_EQ(wait.kind, Kind::kWait);
  EXPECT_EQ(wait.wake_at, std::nullopt);
}

TEST_F(Watching, TheMiddleOfTheMapIsNearestWithoutAPlace) {
  Publish({{0, 0}, {1, 0}, {4, 0}});
  TileWatch watch(history_, {}, AtSeconds(0));
  Notebook notebook;
  Take(watch, notebook);
  // The bounding box ends at 640 m; the middle of tile 1 is 128 m from 320 m, the others' 256 m.
  EXPECT_THAT(notebook.tiles, ElementsAre(TileIndex{1, 0}, TileIndex{0, 0}, TileIndex{4, 0}));
}

TEST_F(Watching, ThenTellsWhatChangedAndWhatWent) {
  Publish({{0, 0}, {1, 0}, {2, 0}});
  TileWatch watch(history_, {}, AtSeconds(0));
  Notebook first;
  TakeAll(watch, first);
  Publish({{1, 0}}, {{2, 0}});
  Notebook second;
  const TileWatch::Turn turn = TakeAll(watch, second);
  EXPECT_FALSE(turn.reset);
  EXPECT_TRUE(turn.complete);
  EXPECT_EQ(turn.base, (MapVersion{kEpoch, 1}));
  EXPECT_EQ(turn.version, (MapVersion{kEpoch, 2}));
  EXPECT_THAT(second.tiles, ElementsAre(TileIndex{1, 0}));
  EXPECT_THAT(second.absent, ElementsAre(TileIndex{2, 0}));
}

TEST_F(Watching, ASlowReaderGetsTheLatestAndHearsHowManyItMissed) {
  Publish({{0, 0}});
  TileWatch watch(history_, {}, AtSeconds(0));
  Notebook first;
  TakeAll(watch, first);
  for (int i = 0; i < 5; ++i) Publish({{0, 0}});
  Notebook second;
  const TileWatch::Turn turn = TakeAll(watch, second);
  EXPECT_THAT(second.tiles, ElementsAre(TileIndex{0, 0}));
  EXPECT_EQ(turn.version.revision, 6u);
  EXPECT_EQ(turn.num_versions_skipped, 4u);
}

TEST_F(Watching, NewsOutsideOfTheRegionAreAnEmptyChange) {
  Publish({{0, 0}});
  TileWatch watch(history_, {.region = Region{0, 0, 128, 128}}, AtSeconds(0));
  Notebook first;
  TakeAll(watch, first);
  EXPECT_THAT(first.tiles, ElementsAre(TileIndex{0, 0}));
  // A neighbour that only shares the edge at 128 m is outside.
  Publish({{1, 0}, {0, 1}, {-1, 0}});
  Notebook second;
  const TileWatch::Turn turn = TakeAll(watch, second);
  EXPECT_TRUE(turn.complete);
  EXPECT_EQ(turn.version.revision, 2u);
  EXPECT_THAT(second.tiles, IsEmpty());
}

TEST_F(Watching, ARegionThatReachesIntoATileHasIt) {
  Publish({{0, 0}, {1, 0}, {-1, -1}});
  TileWatch watch(history_, {.region = Region{-0.01, -0.01, 128.01, 1}}, AtSeconds(0));
  Notebook notebook;
  TakeAll(watch, notebook);
  EXPECT_EQ(notebook.tiles.size(), 3u);
}

TEST_F(Watching, LevelsAboveZeroHaveTilesOfTheirOwn) {
  Publish({{0, 0}});
  history_->Publish(maps_.Next({{0, 0}, {-1, 0}}, {}, 3), AtSeconds(0));
  // Tiles of level 3 are 1024 m wide.
  TileWatch watch(history_, {.level = 3, .region = Region{-1, 0, 1, 1}}, AtSeconds(0));
  Notebook notebook;
  TakeAll(watch, notebook);
  EXPECT_EQ(notebook.tiles.size(), 2u);
  history_->Publish(maps_.Next({}, {{-1, 0}}, 3), AtSeconds(0));
  Notebook second;
  TakeAll(watch, second);
  EXPECT_THAT(second.absent, ElementsAre(TileIndex{-1, 0}));
}

TEST_F(Watching, PartsAreBoundedInBytesAndTiles) {
  std::vector<TileIndex> tiles;
  for (std::int32_t x = 0; x < 100; ++x) tiles.push_back({x, 0});
  Publish(tiles);
  TileWatch watch(history_, {}, AtSeconds(0));
  Notebook large(TileWatch::kPartBytes / 2 + 1);
  EXPECT_FALSE(Take(watch, large).complete);
  EXPECT_EQ(large.tiles.size(), 2u);
  Notebook small(1);
  const TileWatch::Turn second = Take(watch, small);
  EXPECT_EQ(small.tiles.size(), static_cast<std::size_t>(TileWatch::kTilesOfPart_max));
  // Only the first part says reset.
  EXPECT_FALSE(second.reset);
  EXPECT_EQ(second.base, std::nullopt);
  Notebook rest;
  EXPECT_TRUE(TakeAll(watch, rest).complete);
  EXPECT_EQ(large.tiles.size() + small.tiles.size() + rest.tiles.size(), 100u);
}

TEST_F(Watching, AllPartsOfAChangeAreReadFromOneVersion) {
  std::vector<TileIndex> tiles;
  for (std::int32_t x = 0; x < 40; ++x) tiles.push_back({x, 0});
  Publish(tiles);
  TileWatch watch(history_, {}, AtSeconds(0));
  Notebook first;
  Take(watch, first);
  Publish(tiles);
  Notebook second;
  second.newest_max = 1;
  EXPECT_EQ(Take(watch, second).version.revision, 1u);
}

TEST_F(Watching, ResumesWithWhatWasMissed) {
  Publish({{0, 0}, {1, 0}});
  Publish({{2, 0}}, {{0, 0}});
  TileWatch watch(history_, {.since = MapVersion{kEpoch, 1}}, AtSeconds(0));
  Notebook notebook;
  const TileWatch::Turn turn = TakeAll(watch, notebook);
  EXPECT_FALSE(turn.reset);
  EXPECT_EQ(turn.base, (MapVersion{kEpoch, 1}));
  EXPECT_THAT(notebook.tiles, ElementsAre(TileIndex{2, 0}));
  EXPECT_THAT(notebook.absent, ElementsAre(TileIndex{0, 0}));
}

TEST_F(Watching, AReaderThatHasEverythingHearsItAtOnce) {
  Publish({{0, 0}});
  TileWatch watch(history_, {.since = MapVersion{kEpoch, 1}}, AtSeconds(0));
  Notebook notebook;
  const TileWatch::Turn turn = Take(watch, notebook);
  ASSERT_EQ(turn.kind, Kind::kPart);
  EXPECT_TRUE(turn.complete);
  EXPECT_FALSE(turn.reset);
  EXPECT_EQ(turn.num_versions_skipped, 0u);
  EXPECT_THAT(notebook.tiles, IsEmpty());
  EXPECT_EQ(Take(watch, notebook).kind, Kind::kWait);
}

// Resuming works from addresses and revisions alone: the snapshots in between are long gone.
TEST_F(Watching, ResumesAfterTheRetention) {
  Publish({{0, 0}, {1, 0}}, {}, 0);
  Publish({}, {{1, 0}}, 100);
  Publish({{0, 0}}, {}, 200);
  EXPECT_EQ(history_->Find({kEpoch, 1}, AtSeconds(200)), nullptr);
  TileWatch watch(history_, {.since = MapVersion{kEpoch, 1}}, AtSeconds(200));
  Notebook notebook;
  const TileWatch::Turn turn = TakeAll(watch, notebook, 200);
  EXPECT_FALSE(turn.reset);
  EXPECT_THAT(notebook.tiles, ElementsAre(TileIndex{0, 0}));
  EXPECT_THAT(notebook.absent, ElementsAre(TileIndex{1, 0}));
}

TEST_F(Watching, AnotherEpochBeginsAnew) {
  Publish({{0, 0}});
  TileWatch watch(history_, {.since = MapVersion{kEpoch + 1, 1}}, AtSeconds(0));
  Notebook notebook;
  const TileWatch::Turn turn = Take(watch, notebook);
  EXPECT_TRUE(turn.reset);
  EXPECT_EQ(turn.base, std::nullopt);
  EXPECT_THAT(notebook.tiles, ElementsAre(TileIndex{0, 0}));
}

TEST_F(Watching, EndsWhenTheMapIsDeleted) {
  Publish({{0, 0}});
  TileWatch watch(history_, {}, AtSeconds(0));
  Notebook notebook;
  TakeAll(watch, notebook);
  history_->End(maps_.Next({}));
  const TileWatch::Turn turn = Take(watch, notebook);
  EXPECT_EQ(turn.kind, Kind::kEnd);
  EXPECT_EQ(turn.status.code(), absl::StatusCode::kNotFound);
}

// A reader so slow that the version it reads from goes: it gets the newest within the same change,
// tiles that changed meanwhile come again, and complete means complete.
TEST_F(Watching, GoesOnWithTheNewestWhenItsVersionExpires) {
  std::vector<TileIndex> tiles;
  for (std::int32_t x = 0; x < 20; ++x) tiles.push_back({x, 0});
  Publish(tiles);
  TileWatch watch(history_, {.nearest_to = Place{0, 0}}, AtSeconds(0));
  Notebook first;
  EXPECT_FALSE(Take(watch, first, 0).complete);
  EXPECT_THAT(first.tiles, testing::SizeIs(16));
  // Tile 0 was told and changes, tile 1 was told and goes, tile 19 was not told and goes.
  Publish({{0, 0}}, {{1, 0}, {19, 0}}, 10);
  Notebook second;
  const TileWatch::Turn turn = Take(watch, second, 50);
  EXPECT_TRUE(turn.complete);
  EXPECT_EQ(turn.version.revision, 2u);
  EXPECT_FALSE(turn.reset);
  // What was never told first.
  EXPECT_THAT(second.tiles,
              ElementsAre(TileIndex{16, 0}, TileIndex{17, 0}, TileIndex{18, 0}, TileIndex{0, 0}));
  EXPECT_THAT(second.absent, ElementsAre(TileIndex{19, 0}, TileIndex{1, 0}));
}

class WatchingWithoutMemory : public Watching {
 protected:
  WatchingWithoutMemory() : Watching({.retention_s = 0, .tombstones_max = 0}) {}
};

// Neither the version nor the removals are known any more: the change begins anew.
TEST_F(WatchingWithoutMemory, BeginsAnewWhenRemovalsAreForgotten) {
  std::vector<TileIndex> tiles;
  for (std::int32_t x = 0; x < 20; ++x) tiles.push_back({x, 0});
  Publish(tiles);
  TileWatch watch(history_, {.nearest_to = Place{0, 0}}, AtSeconds(0));
  Notebook first;
  Take(watch, first);
  Publish({}, {{1, 0}});
  Notebook second;
  const TileWatch::Turn turn = Take(watch, second);
  EXPECT_TRUE(turn.reset);
  EXPECT_EQ(turn.base, std::nullopt);
  EXPECT_THAT(second.tiles, testing::SizeIs(16));
  Notebook rest;
  const TileWatch::Turn last = TakeAll(watch, rest);
  EXPECT_TRUE(last.complete);
  EXPECT_THAT(rest.tiles, testing::SizeIs(3));
  EXPECT_THAT(rest.absent, IsEmpty());
}

TEST_F(Watching, GathersChangesForAnInterval) {
  Publish({{0, 0}}, {}, 0);
  TileWatch watch(history_, {.min_interval_s = 10}, AtSeconds(0));
  Notebook first;
  EXPECT_TRUE(Take(watch, first, 0).complete);
  Publish({{1, 0}}, {}, 1);
  Notebook second;
  TileWatch::Turn turn = Take(watch, second, 1);
  EXPECT_EQ(turn.kind, Kind::kWait);
  EXPECT_EQ(turn.wake_at, AtSeconds(10));
  Publish({{2, 0}}, {}, 9);
  turn = Take(watch, second, 10);
  EXPECT_EQ(turn.kind, Kind::kPart);
  EXPECT_THAT(second.tiles, testing::SizeIs(2));
  EXPECT_EQ(turn.num_versions_skipped, 1u);
  // After a quiet time the next change comes at once.
  Publish({{0, 0}}, {}, 100);
  EXPECT_EQ(Take(watch, second, 100).kind, Kind::kPart);
}

TEST_F(Watching, KeepsToItsBytesPerSecond) {
  std::vector<TileIndex> tiles;
  for (std::int32_t x = 0; x < 100; ++x) tiles.push_back({x, 0});
  Publish(tiles);
  TileWatch watch(history_, {.bytes_per_s_max = 2000}, AtSeconds(0));
  double now_s = 0;
  std::size_t bytes = 0;
  while (true) {
    Notebook part(1500);
    const TileWatch::Turn turn = Take(watch, part, now_s);
    if (turn.kind == Kind::kWait) {
      ASSERT_TRUE(turn.wake_at.has_value());
      now_s = std::chrono::duration<double>(turn.wake_at->time_since_epoch()).count();
      continue;
    }
    // No burst: parts are as small as the rate allows, a tile at least.
    EXPECT_LE(part.size_bytes(), 3000u);
    bytes += part.size_bytes();
    watch.CountSent(part.size_bytes(), AtSeconds(now_s));
    if (turn.complete) break;
  }
  EXPECT_EQ(bytes, 150'000u);
  // The last part is not waited for.
  EXPECT_NEAR(now_s, (150'000 - 3000) / 2000.0, 0.1);
}

TEST_F(Watching, KnowsSinceWhenItIsBehind) {
  Publish({{0, 0}}, {}, 5);
  TileWatch watch(history_, {}, AtSeconds(7));
  EXPECT_EQ(watch.behind_since(), AtSeconds(7));
  Notebook notebook;
  TakeAll(watch, notebook, 8);
  EXPECT_EQ(watch.behind_since(), std::nullopt);
  Publish({{0, 0}}, {}, 20);
  Publish({{0, 0}}, {}, 30);
  EXPECT_EQ(watch.behind_since(), AtSeconds(20));
}

TEST_F(Watching, AnIntervalThatWasAskedForIsNoLag) {
  Publish({{0, 0}}, {}, 0);
  TileWatch watch(history_, {.min_interval_s = 60}, AtSeconds(0));
  Notebook notebook;
  TakeAll(watch, notebook, 0);
  Publish({{0, 0}}, {}, 1);
  EXPECT_EQ(watch.behind_since(), AtSeconds(60));
}

TEST_F(Watching, OnceIsOneChangeOfOneVersion) {
  std::vector<TileIndex> tiles;
  for (std::int32_t x = 0; x < 20; ++x) tiles.push_back({x, 0});
  Publish(tiles);
  TileWatch whole(history_, {.once = true}, AtSeconds(0));
  Notebook notebook;
  EXPECT_FALSE(Take(whole, notebook).complete);
  Notebook rest;
  EXPECT_TRUE(Take(whole, rest).complete);
  const TileWatch::Turn end = Take(whole, notebook);
  EXPECT_EQ(end.kind, Kind::kEnd);
  EXPECT_TRUE(end.status.ok()) << end.status;

  TileWatch slow(history_, {.once = true}, AtSeconds(0));
  Notebook first;
  Take(slow, first, 0);
  Publish({{0, 0}}, {}, 10);
  const TileWatch::Turn late = Take(slow, first, 50);
  EXPECT_EQ(late.kind, Kind::kEnd);
  EXPECT_EQ(late.status.code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_EQ(ErrorReasonOf(late.status), "REVISION_EXPIRED");
}

/// What a client does with parts: gather, then apply together.
class Mirror {
 public:
  void Take(const TileWatch::Turn& turn, const Notebook& part) {
    if (turn.reset) {
      gathered_.clear();
      held.clear();
    }
    for (std::size_t i = 0; i < part.tiles.size(); ++i)
      gathered_[part.tiles[i]] = part.revisions[i];
    for (const TileIndex index : part.absent) gathered_[index] = 0;
    if (!turn.complete) return;
    for (const auto& [index, revision] : gathered_) {
      if (revision == 0) {
        held.erase(index);
      } else {
        held[index] = revision;
      }
    }
    gathered_.clear();
    version = turn.version;
  }
  void Disconnect() { gathered_.clear(); }

  absl::flat_hash_map<TileIndex, std::uint64_t> held;
  std::optional<MapVersion> version;

 private:
  absl::flat_hash_map<TileIndex, std::uint64_t> gathered_;
};

// Whatever happens in whatever order: at every complete version the reader holds exactly the tiles
// of that version.
TEST(WatchingAtRandom, CompleteVersionsAreExact) {
  for (std::uint32_t seed = 0; seed < 200; ++seed) {
    std::mt19937 random(seed);
    const auto chance = [&](int percent) { return static_cast<int>(random() % 100) < percent; };
    const auto some_tile = [&] {
      return TileIndex{static_cast<std::int32_t>(random() % 9) - 4,
                       static_cast<std::int32_t>(random() % 9) - 4};
    };
    test::MadeMaps maps;
    const HistoryOptions options{.retention_s = chance(50) ? 30.0 : 2.0,
                                 .bytes_max = chance(50) ? 1u << 30 : 40u << 20,
                                 .tombstones_max = chance(50) ? 1000u : 10u};
    const auto history = std::make_shared<MapHistory>(maps.Current(), options);
    TileWatchOptions watch_options;
    if (chance(50)) watch_options.region = Region{-300, -200, 130, 257};
    std::optional<TileRange> range;
    if (watch_options.region.has_value()) range = TilesTouching(*watch_options.region, 0, 1);
    absl::flat_hash_map<std::uint64_t, std::shared_ptr<const MapSnapshot>> all;
    Mirror mirror;
    auto watch = std::make_unique<TileWatch>(history, watch_options, AtSeconds(0));
    double now_s = 0;
    for (int step = 0; step < 150; ++step) {
      now_s += 0.1 * static_cast<double>(random() % 20);
      if (chance(40)) {
        std::vector<TileIndex> changed, gone;
        for (auto i = random() % (chance(20) ? 60 : 5); i > 0; --i)
          (chance(70) ? changed : gone).push_back(some_tile());
        const auto snapshot = maps.Next(changed, gone);
        all[snapshot->version.revision] = snapshot;
        history->Publish(snapshot, AtSeconds(now_s));
        history->Trim(AtSeconds(now_s));
      }
      if (chance(5)) {
        mirror.Disconnect();
        watch_options.since = mirror.version;
        watch = std::make_unique<TileWatch>(history, watch_options, AtSeconds(now_s));
      }
      Notebook part(chance(50) ? 20'000 : 100);
      const TileWatch::Turn turn = watch->TakeTurn(AtSeconds(now_s), part);
      if (turn.kind != Kind::kPart) continue;
      mirror.Take(turn, part);
      if (!turn.complete || turn.version.revision == 0) continue;
      absl::flat_hash_map<TileIndex, std::uint64_t> want;
      for (const auto& [index, tile] : all[turn.version.revision]->tiles)
        if (!range.has_value() || range->Contains(index)) want[index] = tile->version.revision;
      ASSERT_EQ(mirror.held, want) << "seed " << seed << ", step " << step;
    }
  }
}

}  // namespace
}  // namespace gem
