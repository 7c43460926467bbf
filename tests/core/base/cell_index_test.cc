#include "core/grid/cell_index.h"

#include <gtest/gtest.h>

#include <limits>

namespace gem {
namespace {

TEST(CellOf, RoundsDownAlsoBelowZero) {
  EXPECT_EQ(CellOf(0.0, 0.5), 0);
  EXPECT_EQ(CellOf(0.49, 0.5), 0);
  EXPECT_EQ(CellOf(0.5, 0.5), 1) << "a cell owns its lower border";
  EXPECT_EQ(CellOf(-0.01, 0.5), -1);
  EXPECT_EQ(CellOf(-0.5, 0.5), -1);
  EXPECT_EQ(CellOf(-0.51, 0.5), -2);
}

TEST(CellOf, FindsTheCellOfEveryCentre) {
  for (const double cell_size_m : {0.01, 0.1, 0.2, 0.25, 10.0})
    for (const std::int32_t cell : {-100'000'000, -12345, -1, 0, 1, 777, 100'000'000})
      EXPECT_EQ(CellOf(CenterOf(cell, cell_size_m), cell_size_m), cell);
}

TEST(TileOf, PutsNegativeCellsIntoNegativeTiles) {
  EXPECT_EQ(TileOf({0, 127}), (TileIndex{0, 0}));
  EXPECT_EQ(TileOf({128, -1}), (TileIndex{1, -1}));
  EXPECT_EQ(TileOf({-128, -129}), (TileIndex{-1, -2}));
}

TEST(IndexInTile, IsRowTimesColumnsPlusColumnFromTheLowerLeft) {
  EXPECT_EQ(IndexInTile({0, 0}), 0);
  EXPECT_EQ(IndexInTile({127, 0}), 127);
  EXPECT_EQ(IndexInTile({0, 1}), 128);
  EXPECT_EQ(IndexInTile({-1, -1}), 127 * 128 + 127);
  EXPECT_EQ(IndexInTile({-128, -128}), 0);
}

TEST(IndexInTile, IsOneToOne) {
  const CellIndex origin = OriginOf(TileIndex{-3, 5});
  EXPECT_EQ(origin, (CellIndex{-384, 640}));
  std::int32_t want = 0;
  for (CellIndex c = origin; c.y < origin.y + kTileCells; ++c.y) {
    for (c.x = origin.x; c.x < origin.x + kTileCells; ++c.x) {
      ASSERT_EQ(TileOf(c), (TileIndex{-3, 5}));
      ASSERT_EQ(IndexInTile(c), want++);
    }
  }
}

TEST(PackedKey, OrdersByRowThenColumn) {
  EXPECT_LT(PackedKey({5, -1}), PackedKey({-5, 0}));
  EXPECT_LT(PackedKey({-1, 3}), PackedKey({0, 3}));
  constexpr std::int32_t kMin = std::numeric_limits<std::int32_t>::min();
  constexpr std::int32_t kMax = std::numeric_limits<std::int32_t>::max();
  EXPECT_EQ(PackedKey({kMin, kMin}), 0u);
  EXPECT_EQ(PackedKey({kMax, kMax}), std::numeric_limits<std::uint64_t>::max());
}

TEST(FloorMod, HasTheSignOfTheDivisor) {
  EXPECT_EQ(FloorMod(-1, 40), 39);
  EXPECT_EQ(FloorMod(-40, 40), 0);
  EXPECT_EQ(FloorMod(-41, 40), 39);
  EXPECT_EQ(FloorMod(79, 40), 39);
}

TEST(CellRect, IsHalfOpen) {
  const CellRect rect{{-2, 0}, {3, 1}};
  EXPECT_TRUE(rect.Contains({-2, 0}));
  EXPECT_TRUE(rect.Contains({2, 0}));
  EXPECT_FALSE(rect.Contains({3, 0}));
  EXPECT_FALSE(rect.Contains({0, 1}));
  EXPECT_FALSE(rect.empty());
  EXPECT_TRUE((CellRect{{0, 0}, {0, 5}}).empty());
}

}  // namespace
}  // namespace gem
