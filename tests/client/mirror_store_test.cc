#include "client/mirror_store.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <thread>

namespace gem::client {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::UnorderedElementsAre;
using Taken = MirrorStore::Taken;

constexpr std::uint64_t kEpoch = 5;

/// Every cell has the value as elevation and traversability.
MapTile Full(TileIndex index, float value, std::uint64_t etag = 0) {
  auto grid = std::make_shared<LayeredGrid>(LayeredGrid{kTileCells, kTileCells, 0.5, {}});
  for (const Layer layer : {Layer::kElevation, Layer::kTraversability})
    grid->layers.push_back({layer,
                            std::vector<std::uint8_t>(grid->num_cells(), 1),
                            std::vector<float>(grid->num_cells(), value),
                            {}});
  return {index, {}, etag, std::move(grid)};
}
MapTile Gone(TileIndex index) { return {index, {}, 0, nullptr}; }

MirrorPart Snapshot(std::uint64_t revision, std::vector<MapTile> tiles, bool complete = true) {
  return {std::nullopt, {kEpoch, revision}, true, std::move(tiles), complete, 0};
}
MirrorPart Change(std::uint64_t from, std::uint64_t to, std::vector<MapTile> tiles,
                  bool complete = true) {
  return {MapVersion{kEpoch, from}, {kEpoch, to}, false, std::move(tiles), complete, 0};
}
/// A further part of a snapshot: no base, no reset.
MirrorPart Rest(std::uint64_t revision, std::vector<MapTile> tiles, bool complete = true) {
  return {std::nullopt, {kEpoch, revision}, false, std::move(tiles), complete, 0};
}

class MirrorStoreTest : public ::testing::Test {
 protected:
  MirrorStoreTest() { store_.SetGeometry({2, 0.5, 0.7f, kEpoch}); }

  Taken Take(MirrorPart part) {
    const absl::StatusOr<Taken> taken = store_.Take(std::move(part));
    EXPECT_TRUE(taken.ok()) << taken.status();
    return taken.ok() ? *taken : Taken::kPart;
  }
  std::vector<TileIndex> Tiles() const {
    std::vector<TileIndex> tiles;
    for (const auto& [index, tile] : store_.snapshot()->tiles) tiles.push_back(index);
    return tiles;
  }

  MirrorStore store_{4};
};

TEST_F(MirrorStoreTest, ShowsNothingBeforeTheFirstSnapshotIsComplete) {
  EXPECT_EQ(store_.snapshot(), nullptr);
  EXPECT_EQ(Take(Snapshot(1, {Full({0, 0}, 1)}, false)), Taken::kPart);
  EXPECT_EQ(store_.snapshot(), nullptr);
  EXPECT_FALSE(store_.held().has_value());
  EXPECT_EQ(Take(Rest(1, {Full({-1, 0}, 1)})), Taken::kVersion);
  EXPECT_THAT(Tiles(), UnorderedElementsAre(TileIndex{0, 0}, TileIndex{-1, 0}));
  EXPECT_EQ(store_.held(), (MapVersion{kEpoch, 1}));
  EXPECT_EQ(store_.snapshot()->level, 2);
  EXPECT_EQ(store_.snapshot()->traversability_free, 0.7f);
}

TEST_F(MirrorStoreTest, AChangeShowsAllAtOnceWithRemovals) {
  Take(Snapshot(1, {Full({0, 0}, 1), Full({1, 0}, 1)}));
  const auto before = store_.snapshot();
  EXPECT_EQ(Take(Change(1, 3, {Full({0, 0}, 2)}, false)), Taken::kPart);
  EXPECT_EQ(store_.snapshot(), before) << "half of a change must not show";
  EXPECT_EQ(Take(Change(1, 3, {Gone({1, 0}), Full({2, 0}, 2)})), Taken::kVersion);
  EXPECT_THAT(Tiles(), UnorderedElementsAre(TileIndex{0, 0}, TileIndex{2, 0}));
  EXPECT_EQ(store_.snapshot()->ValueAt(Layer::kElevation, {1, 1}), 2);
  EXPECT_THAT(store_.changed(),
              UnorderedElementsAre(TileIndex{0, 0}, TileIndex{1, 0}, TileIndex{2, 0}));
  // Who holds the old version keeps it whole.
  EXPECT_EQ(before->ValueAt(Layer::kElevation, {1, 1}), 1);
  EXPECT_EQ(before->tiles.size(), 2u);
}

TEST_F(MirrorStoreTest, AnAddressThatComesTwiceCountsAsItCameLast) {
  Take(Snapshot(1, {Full({0, 0}, 1)}));
  Take(Change(1, 2, {Full({1, 0}, 2), Gone({0, 0})}, false));
  Take(Change(1, 2, {Gone({1, 0}), Full({0, 0}, 3)}));
  EXPECT_THAT(Tiles(), ElementsAre(TileIndex{0, 0}));
  EXPECT_EQ(store_.snapshot()->ValueAt(Layer::kElevation, {1, 1}), 3);
}

TEST_F(MirrorStoreTest, RefusesAChangeOfWhatIsNotHeld) {
  EXPECT_TRUE(absl::IsAborted(store_.Take(Change(1, 2, {})).status()));
  Take(Snapshot(5, {}));
  const absl::Status status = store_.Take(Change(4, 6, {})).status();
  EXPECT_TRUE(absl::IsAborted(status));
  EXPECT_THAT(std::string(status.message()),
              HasSubstr("a change of 5.4, want one of 5.5, which is held"));
  EXPECT_EQ(Take(Change(5, 6, {})), Taken::kVersion) << "what was refused has changed nothing";
}

// A fuzzer found this: a stream that begins with a part of nothing ended the process.
TEST_F(MirrorStoreTest, RefusesAChangeOfNothingThatIsNoSnapshot) {
  EXPECT_TRUE(absl::IsAborted(store_.Take(Rest(1, {Full({0, 0}, 1)})).status()));
  EXPECT_EQ(store_.snapshot(), nullptr);
}

TEST_F(MirrorStoreTest, RefusesAnotherEpochThanTheGeometrys) {
  MirrorPart part = Snapshot(1, {});
  part.version.epoch = 6;
  EXPECT_TRUE(absl::IsAborted(store_.Take(std::move(part)).status()));
  EXPECT_EQ(store_.snapshot(), nullptr);
}

TEST_F(MirrorStoreTest, ASnapshotReplacesEverything) {
  Take(Snapshot(1, {Full({0, 0}, 1, 10), Full({1, 0}, 1, 11), Full({2, 0}, 1, 12)}));
  const auto before = store_.snapshot();
  // One is the same by its etag, one has other cells, one is not there any more.
  Take(Snapshot(9, {Full({0, 0}, 1, 10), Full({1, 0}, 2, 20)}));
  EXPECT_THAT(Tiles(), UnorderedElementsAre(TileIndex{0, 0}, TileIndex{1, 0}));
  EXPECT_THAT(store_.changed(), UnorderedElementsAre(TileIndex{1, 0}, TileIndex{2, 0}));
  EXPECT_EQ(store_.snapshot()->tiles.at({0, 0}).grid, before->tiles.at({0, 0}).grid);
}

// The server may lose its history while it tells a change.
TEST_F(MirrorStoreTest, AResetInTheMiddleOfAChangeForgetsItsParts) {
  Take(Snapshot(1, {Full({0, 0}, 1)}));
  Take(Change(1, 2, {Full({1, 0}, 1)}, false));
  Take(Snapshot(3, {Full({2, 0}, 1)}, false));
  Take(Rest(3, {Full({3, 0}, 1)}));
  EXPECT_THAT(Tiles(), UnorderedElementsAre(TileIndex{2, 0}, TileIndex{3, 0}));
}

TEST_F(MirrorStoreTest, PartsOfABrokenStreamAreDropped) {
  Take(Snapshot(1, {Full({0, 0}, 1)}));
  Take(Change(1, 2, {Gone({0, 0})}, false));
  store_.DropParts();
  EXPECT_EQ(store_.held(), (MapVersion{kEpoch, 1}));
  Take(Change(1, 3, {Full({1, 0}, 1)}));
  EXPECT_THAT(Tiles(), UnorderedElementsAre(TileIndex{0, 0}, TileIndex{1, 0}));
}

TEST_F(MirrorStoreTest, KnowsWhenThereIsNothingNew) {
  Take(Snapshot(1, {}));
  const auto before = store_.snapshot();
  EXPECT_EQ(Take(Change(1, 1, {})), Taken::kNothingNew);
  EXPECT_EQ(store_.snapshot(), before);
  // Another version without a tile that changed is a version all the same.
  EXPECT_EQ(Take(Change(1, 2, {})), Taken::kVersion);
  EXPECT_EQ(store_.snapshot()->version.revision, 2u);
  EXPECT_THAT(store_.changed(), IsEmpty());
}

TEST_F(MirrorStoreTest, HoldsNoMoreTilesThanItMay) {
  Take(Snapshot(1, {Full({0, 0}, 1), Full({1, 0}, 1), Full({2, 0}, 1), Full({3, 0}, 1)}));
  // One goes, one comes: still four.
  Take(Change(1, 2, {Gone({0, 0}), Full({9, 0}, 1)}));
  const absl::Status status = store_.Take(Change(2, 3, {Full({10, 0}, 1)}, false)).status();
  EXPECT_TRUE(absl::IsResourceExhausted(status)) << status;
  EXPECT_THAT(std::string(status.message()), HasSubstr("more than 4 tiles"));
  EXPECT_EQ(store_.snapshot()->version.revision, 2u);
}

// Addresses cost memory as well: those of which nothing is held are not kept.
TEST_F(MirrorStoreTest, RemovalsOfWhatIsNotHeldAreNothing) {
  Take(Snapshot(1, {Full({0, 0}, 1)}));
  for (std::int32_t x = 100; x < 1100; ++x) Take(Change(1, 2, {Gone({x, 0})}, false));
  EXPECT_EQ(Take(Change(1, 2, {Gone({0, 0})})), Taken::kVersion);
  EXPECT_THAT(store_.changed(), ElementsAre(TileIndex{0, 0}));
}

TEST_F(MirrorStoreTest, ReadersSeeWholeVersionsWhileTheWriterWrites) {
  const auto tiles = [](float value) {
    return std::vector<MapTile>{Full({0, 0}, value), Full({1, 0}, value)};
  };
  Take(Snapshot(1, tiles(1)));
  std::atomic<bool> done{false};
  std::thread reader([&] {
    std::uint64_t newest = 0;
    while (!done) {
      const auto map = store_.snapshot();
      const auto revision = static_cast<float>(map->version.revision);
      EXPECT_EQ(map->ValueAt(Layer::kElevation, {1, 1}), revision);
      EXPECT_EQ(map->ValueAt(Layer::kElevation, {65, 1}), revision);
      EXPECT_GE(map->version.revision, newest);
      newest = map->version.revision;
    }
  });
  for (std::uint64_t revision = 2; revision < 200; ++revision)
    Take(Change(revision - 1, revision, tiles(static_cast<float>(revision))));
  done = true;
  reader.join();
}

TEST(MirroredMap, FindsCellsByTheirPlaceAndUnknownIsNotFree) {
  MirroredMap map;
  map.cell_size_m = 0.5;
  map.traversability_free = 0.7f;
  EXPECT_FALSE(map.IsFree({0, 0})) << "no tile";
  MapTile tile = Full({-1, 0}, 1);
  auto grid = std::make_shared<LayeredGrid>(*tile.grid);
  // Cell (-1, 2) is not known; cell (-2, 2) is an obstacle.
  const auto index = [](CellIndex cell) { return static_cast<std::size_t>(IndexInTile(cell)); };
  grid->layers[1].valid[index({-1, 2})] = 0;
  grid->layers[1].values[index({-2, 2})] = 0.7f;
  tile.grid = grid;
  map.tiles[{-1, 0}] = tile;
  EXPECT_FALSE(map.IsFree({-0.25, 1.25}));
  EXPECT_EQ(map.ValueAt(Layer::kTraversability, {-0.25, 1.25}), std::nullopt);
  EXPECT_EQ(map.ValueAt(Layer::kElevation, {-0.25, 1.25}), 1);
  EXPECT_FALSE(map.IsFree({-0.75, 1.25}));
  EXPECT_TRUE(map.IsFree({-1.25, 1.25}));
  EXPECT_EQ(map.ValueAt(Layer::kVariance, {-1.25, 1.25}), std::nullopt) << "was not asked for";
  EXPECT_FALSE(map.IsFree({std::nan(""), 0}));
  EXPECT_FALSE(map.IsFree({1e300, 0}));
}

}  // namespace
}  // namespace gem::client
