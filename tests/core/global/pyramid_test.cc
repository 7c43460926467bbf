#include "core/global/pyramid.h"

#include <gtest/gtest.h>

#include <random>

#include "core/global/global_mapper.h"
#include "scenes.h"

namespace gem {
namespace {

using test::kSecond_ns;

constexpr float kFree = 0.7f;

CellBelief Known(float elevation_m, float variance_m2 = 0.01f, std::int64_t stamp_ns = 1) {
  CellBelief cell;
  cell.elevation_m = elevation_m;
  cell.variance_m2 = variance_m2;
  cell.stamp_ns = stamp_ns;
  cell.state = kCellKnown;
  return cell;
}

CellBelief Annotated(float traversability) {
  CellBelief cell = Known(0);
  cell.traversability = traversability;
  cell.state |= kCellAnnotated;
  return cell;
}

CellBelief Colored(Rgba rgba, float variance_m2) {
  CellBelief cell = Known(0, variance_m2);
  cell.rgba = rgba;
  cell.state |= kCellColored;
  return cell;
}

CellBelief CoarsenOf(const CellBelief& a, const CellBelief& b, const CellBelief& c,
                     const CellBelief& d) {
  return Coarsen({&a, &b, &c, &d}, kFree);
}

TEST(Coarsen, KnowsNothingOfUnknownCells) { EXPECT_EQ(CoarsenOf({}, {}, {}, {}), CellBelief{}); }

TEST(Coarsen, KeepsACellThatStandsAlone) {
  EXPECT_EQ(CoarsenOf({}, {}, Known(1.5f, 0.02f, 7), {}), Known(1.5f, 0.02f, 7));
}

TEST(Coarsen, KeepsFlatGround) {
  // Four measurements of a height are not a surer height of a place four times as large.
  const CellBelief cell = Known(0.1f, 0.04f);
  EXPECT_EQ(CoarsenOf(cell, cell, cell, cell), cell);
}

TEST(Coarsen, WeighsHeightsByInverseVarianceAndCountsTheirSpread) {
  // Weights 100 and 25, that is 0.8 and 0.2: mean 0.8 * 1 + 0.2 * 2 = 1.2; variance
  // 0.8 * (0.01 + 0.2^2) + 0.2 * (0.04 + 0.8^2) = 0.04 + 0.136.
  const CellBelief coarse = CoarsenOf(Known(1, 0.01f), {}, {}, Known(2, 0.04f));
  EXPECT_FLOAT_EQ(coarse.elevation_m, 1.2f);
  EXPECT_FLOAT_EQ(coarse.variance_m2, 0.176f);
}

TEST(Coarsen, IsNotSilencedByAHeightWithoutVariance) {
  const CellBelief coarse = CoarsenOf(Known(1, 0), Known(3, 0), {}, {});
  EXPECT_EQ(coarse.elevation_m, 2);
  EXPECT_EQ(coarse.variance_m2, 1);
}

TEST(Coarsen, TakesTheNewestStampOfKnownCells) {
  CellBelief unknown;
  unknown.stamp_ns = 99;  // a stamp without a cell
  EXPECT_EQ(CoarsenOf(Known(0, 1, 5), unknown, Known(0, 1, 8), Known(0, 1, 6)).stamp_ns, 8);
  EXPECT_EQ(CoarsenOf({}, Known(0, 1, -5), {}, Known(0, 1, -8)).stamp_ns, -5);
}

TEST(Coarsen, NeverLosesAnObstacle) {
  EXPECT_EQ(CoarsenOf(Annotated(0.9f), Annotated(0.2f), Annotated(1), Annotated(0.8f)),
            Annotated(0.2f));
  EXPECT_EQ(CoarsenOf({}, Annotated(0.2f), Known(0), {}), Annotated(0.2f))
      << "also beside the unknown";
  EXPECT_EQ(CoarsenOf(Annotated(kFree), {}, {}, {}), Annotated(kFree)) << "free is above 0.7";
}

TEST(Coarsen, IsFreeOnlyIfAllFourAre) {
  EXPECT_EQ(CoarsenOf(Annotated(0.9f), Annotated(0.8f), Annotated(1), Annotated(0.9f)),
            Annotated(0.8f));
  EXPECT_FALSE(CoarsenOf(Annotated(0.9f), {}, Annotated(1), Annotated(0.9f)).annotated());
  const CellBelief coarse = CoarsenOf(Annotated(0.9f), Known(0), Annotated(1), Annotated(0.9f));
  EXPECT_FALSE(coarse.annotated()) << "known, but not known to be free";
  EXPECT_EQ(coarse.traversability, 0) << "values whose state bit is not set are zero";
}

TEST(Coarsen, MixesColorsOfThoseThatHaveOne) {
  // Weights 0.75 and 0.25: red 0.75 * 200 + 0.25 * 100 = 175, green 30, blue 0.25 * 255 = 63.75.
  const CellBelief coarse =
      CoarsenOf(Colored(0xff0028c8, 0.01f), Colored(0xffff0064, 0.03f), Known(0, 1e-6f), {});
  EXPECT_EQ(coarse.rgba, 0xff401eafu);
  EXPECT_TRUE(coarse.colored());
  EXPECT_FALSE(CoarsenOf(Known(0), Known(0), Known(0), Known(0)).colored());
}

/// Level 0 that is changed at random, and what is made of it.
class RandomTiles {
 public:
  explicit RandomTiles(unsigned seed) : random_(seed) { options_.compose_threads = 2; }

  /// Adds, changes or removes a few tiles.
  std::vector<TileIndex> Change() {
    ++map_.version.revision;
    std::vector<TileIndex> changed;
    for (int i = 0; i < 3; ++i) {
      const TileIndex index{Uniform(-9, 8), Uniform(-5, 4)};
      if (std::find(changed.begin(), changed.end(), index) != changed.end()) continue;
      changed.push_back(index);
      if (Uniform(0, 3) == 0)
        map_.tiles.erase(index);
      else
        map_.tiles[index] = MakeTile(index);
    }
    return changed;
  }

  MapSnapshot Afresh() const {
    MapSnapshot afresh;
    afresh.tiles = map_.tiles;
    std::vector<TileIndex> all;
    for (const auto& [index, tile] : map_.tiles) all.push_back(index);
    EXPECT_TRUE(UpdatePyramid(all, options_, CancelToken(), afresh));
    return afresh;
  }

  MapSnapshot& map() { return map_; }
  const GlobalMapOptions& options() const { return options_; }

 private:
  std::int32_t Uniform(std::int32_t low, std::int32_t high) {
    return std::uniform_int_distribution<std::int32_t>(low, high)(random_);
  }

  std::shared_ptr<const Tile> MakeTile(TileIndex index) {
    Tile tile{0, index, map_.version, std::vector<CellBelief>(kTileCells * kTileCells)};
    tile.cells[0] = Known(1);
    for (int i = 0; i < 2000; ++i) {
      CellBelief& cell = tile.cells[static_cast<std::size_t>(Uniform(0, 128 * 128 - 1))];
      cell = Uniform(0, 1) == 0 ? Annotated(0.1f * static_cast<float>(Uniform(0, 10)))
                                : Colored(0xff000000u | static_cast<Rgba>(Uniform(0, 0xffffff)), 1);
      cell.elevation_m = 0.01f * static_cast<float>(Uniform(-100, 100));
      cell.stamp_ns = Uniform(0, 1000);
    }
    return std::make_shared<const Tile>(std::move(tile));
  }

  std::mt19937 random_;
  GlobalMapOptions options_;
  MapSnapshot map_;
};

void ExpectSameLevels(const MapSnapshot& a, const MapSnapshot& b) {
  for (int level = 0; level <= kLevelMax; ++level) {
    ASSERT_EQ(a.TilesOf(level).size(), b.TilesOf(level).size()) << "level " << level;
    for (const auto& [index, tile] : a.TilesOf(level)) {
      ASSERT_TRUE(b.TilesOf(level).contains(index));
      ASSERT_TRUE(b.TilesOf(level).at(index)->cells == tile->cells);
      ASSERT_EQ(tile->level, level);
      ASSERT_EQ(tile->index, index);
    }
  }
}

class UpdatePyramidAtRandom : public testing::TestWithParam<unsigned> {};

TEST_P(UpdatePyramidAtRandom, EqualsAPyramidThatIsMadeAfresh) {
  RandomTiles tiles(GetParam());
  for (int step = 0; step < 12; ++step) {
    const std::vector<TileIndex> changed = tiles.Change();
    ASSERT_TRUE(UpdatePyramid(changed, tiles.options(), CancelToken(), tiles.map()));
    ExpectSameLevels(tiles.map(), tiles.Afresh());
    if (HasFatalFailure()) return;
  }
  EXPECT_EQ(tiles.map().TilesOf(kLevelMax).size(), 4u) << "one in each quadrant of G";
}

INSTANTIATE_TEST_SUITE_P(Seeds, UpdatePyramidAtRandom, testing::Range(0u, 4u));

TEST(UpdatePyramid, BuildsOnlyWhatCoversAChange) {
  RandomTiles tiles(7);
  MapSnapshot& map = tiles.map();
  for (int i = 0; i < 20; ++i)
    ASSERT_TRUE(UpdatePyramid(tiles.Change(), tiles.options(), CancelToken(), map));
  const MapSnapshot before = map;

  // One cell, in tile (-3, 2), so in (-2, 1) of level 1 and (-1, 0) of the levels above.
  map.version.revision = 1000;
  Tile changed{0, {-3, 2}, map.version, std::vector<CellBelief>(kTileCells * kTileCells)};
  changed.cells[5] = Known(77);
  map.tiles[{-3, 2}] = std::make_shared<const Tile>(changed);
  ASSERT_TRUE(UpdatePyramid({{-3, 2}}, tiles.options(), CancelToken(), map));
  for (int level = 1; level <= kLevelMax; ++level) {
    const TileIndex parent = TileAtLevel(level, {-3, 2});
    for (const auto& [index, tile] : map.TilesOf(level)) {
      const bool same =
          before.TilesOf(level).contains(index) && before.TilesOf(level).at(index) == tile;
      EXPECT_EQ(same, index != parent) << "level " << level;
      EXPECT_EQ(tile->version.revision == 1000, index == parent) << "level " << level;
    }
  }
}

TEST(UpdatePyramid, StopsWhereACoarserTileComesOutAsItWas) {
  MapSnapshot map;
  map.version.revision = 1;
  Tile tile{0, {0, 0}, {}, std::vector<CellBelief>(kTileCells * kTileCells)};
  tile.cells[0] = Annotated(0.2f);
  map.tiles[{0, 0}] = std::make_shared<const Tile>(tile);
  ASSERT_TRUE(UpdatePyramid({{0, 0}}, {}, CancelToken(), map));
  const auto before = map.coarser;

  // The tile is another one, and nothing of it differs.
  map.version.revision = 2;
  map.tiles[{0, 0}] = std::make_shared<const Tile>(tile);
  ASSERT_TRUE(UpdatePyramid({{0, 0}}, {}, CancelToken(), map));
  EXPECT_EQ(map.coarser, before);
}

TEST(UpdatePyramid, LeavesNothingOfAMapThatIsGone) {
  RandomTiles tiles(3);
  ASSERT_TRUE(UpdatePyramid(tiles.Change(), tiles.options(), CancelToken(), tiles.map()));
  std::vector<TileIndex> all;
  for (const auto& [index, tile] : tiles.map().tiles) all.push_back(index);
  tiles.map().tiles.clear();
  ASSERT_TRUE(UpdatePyramid(all, tiles.options(), CancelToken(), tiles.map()));
  for (int level = 0; level <= kLevelMax; ++level)
    EXPECT_TRUE(tiles.map().TilesOf(level).empty()) << "level " << level;
}

TEST(UpdatePyramid, StopsWhenCancelled) {
  RandomTiles tiles(3);
  CancelToken cancel;
  cancel.Cancel();
  EXPECT_FALSE(UpdatePyramid(tiles.Change(), tiles.options(), cancel, tiles.map()));
}

TEST(Pyramid, IsPublishedWithItsTiles) {
  GlobalMapper mapper(GlobalMapOptions{}, 1);
  ASSERT_TRUE(mapper.AddSession("s", "r", {}).ok());
  // 200 cells wide from -100: 100 cells of 0.4 m, 3.125 of 12.8 m.
  const auto told =
      mapper.Update("s", {.odometry = {{kSecond_ns, {}}},
                          .active = test::MakeSubmap("s", kSecond_ns, test::AtCells(0, 0),
                                                     {{-100, 0}, {100, 8}}, test::Flat(0.5f))});
  ASSERT_TRUE(told.ok());
  CommitReport report;
  const auto map = mapper.Commit(CancelToken(), report);
  const std::array<std::size_t, kLevelMax + 1> want = {1600, 400, 100, 26, 14, 8, 4};
  for (int level = 0; level <= kLevelMax; ++level) {
    std::size_t known = 0, annotated = 0;
    for (const auto& [index, tile] : map->TilesOf(level)) {
      EXPECT_EQ(tile->version, map->version);
      for (const CellBelief& cell : tile->cells) {
        known += cell.known();
        annotated += cell.annotated();
        EXPECT_EQ(cell.elevation_m, cell.known() ? 0.5f : 0);
      }
    }
    EXPECT_EQ(known, want[static_cast<std::size_t>(level)]) << "level " << level;
    // 24 of the 26 cells of level 3 lie on the 200 cells whole; none of level 4 does, 16 cells
    // high.
    const std::size_t whole = level <= 2 ? known : level == 3 ? 24 : 0;
    EXPECT_EQ(annotated, whole) << "level " << level;
  }
  EXPECT_GT(report.seconds.coarsen, 0);
}

TEST(Pyramid, FollowsACorrectionLikeOneThatIsMadeAfterIt) {
  const auto drive = [](GlobalMapper& mapper) {
    EXPECT_TRUE(mapper.AddSession("s", "r", {}).ok());
    SessionUpdate update;
    for (int i = 1; i <= 60; ++i)
      update.odometry.push_back(
          {i * kSecond_ns, Pose<Odom, Base>::FromTranslation(10.0 * i, 0, 0)});
    for (int i = 1; i <= 60; i += 6)
      update.finished.push_back(test::MakeSubmap(
          "s", i * kSecond_ns, test::AtCells(50 * i, 0), {{-30, -20}, {30, 20}},
          [i](CellIndex c) { return 0.1f * static_cast<float>((c.x + c.y * i) % 5); }));
    EXPECT_TRUE(mapper.Update("s", std::move(update)).ok());
  };
  const auto correct = [](GlobalMapper& mapper) {
    const auto T_G_O = Pose<Global, Odom>::FromYaw(0.3, {5, -80, 1});
    const auto pose = [&](int i) {
      return T_G_O * Pose<Odom, Base>::FromTranslation(10.0 * i, 0, 0);
    };
    EXPECT_TRUE(mapper.Correct("s", {{kSecond_ns, pose(1)}, {60 * kSecond_ns, pose(60)}}).ok());
  };
  CommitReport report;
  GlobalMapper step_by_step(GlobalMapOptions{}, 1);
  drive(step_by_step);
  const auto before = step_by_step.Commit(CancelToken(), report);
  correct(step_by_step);
  GlobalMapper at_once(GlobalMapOptions{}, 1);
  drive(at_once);
  correct(at_once);
  const auto after = step_by_step.Commit(CancelToken(), report);
  ExpectSameLevels(*after, *at_once.Commit(CancelToken(), report));
  EXPECT_GT(after->TilesOf(1).size(), 2u);
  EXPECT_FALSE(test::SameCells(*before, *after));
}

}  // namespace
}  // namespace gem
