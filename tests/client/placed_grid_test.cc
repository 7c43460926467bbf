#include "client/placed_grid.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace gem::client {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

/// A tile in which only the given cells are known; elevation is x + 1000 * y of the cell.
MapTile TileWith(TileIndex index, const std::vector<CellIndex>& cells) {
  LayeredGrid grid{kTileCells, kTileCells, 0.5, {}};
  GridLayer layer{Layer::kElevation, {}, {}, {}};
  layer.valid.resize(grid.num_cells());
  layer.values.resize(grid.num_cells());
  for (const CellIndex cell : cells) {
    EXPECT_EQ(TileOf(cell), index);
    const auto place = static_cast<std::size_t>(IndexInTile(cell));
    layer.valid[place] = 1;
    layer.values[place] = static_cast<float>(cell.x + 1000 * cell.y);
  }
  grid.layers.push_back(layer);
  return {index, {}, 0, std::make_shared<const LayeredGrid>(std::move(grid))};
}

TiledMap MapOf(const std::vector<MapTile>& tiles) {
  TiledMap map;
  map.matrix.cell_size_m = 0.5;
  map.matrix.traversability_free = 0.7f;
  map.tiles.tiles = tiles;
  return map;
}

TEST(Join, CutsToTheKnownCellsAcrossTileBorders) {
  const auto placed = Join(MapOf({TileWith({-1, 0}, {{-2, 1}, {-1, 0}}), TileWith({0, 0}, {{0, 1}}),
                                  MapTile{{7, 7}, {}, 0, nullptr}}),
                           std::nullopt, {Layer::kElevation});
  ASSERT_TRUE(placed.ok()) << placed.status();
  EXPECT_EQ(placed->origin, (CellIndex{-2, 0}));
  EXPECT_EQ(placed->grid.columns, 3);
  EXPECT_EQ(placed->grid.rows, 2);
  EXPECT_EQ(placed->traversability_free, 0.7f);
  const GridLayer& layer = *placed->grid.Find(Layer::kElevation);
  EXPECT_THAT(layer.valid, ElementsAre(0, 1, 0, 1, 0, 1));
  EXPECT_THAT(layer.values, ElementsAre(0, -1, 0, 998, 0, 1000));
}

TEST(Join, TakesTheCellsWithCentresInTheRegion) {
  // Cells of 0.5 m: centres at -0.25, 0.25, 0.75.
  const TiledMap map = MapOf({TileWith({0, 0}, {{0, 0}, {1, 0}, {2, 0}})});
  const auto placed = Join(map, Region{-0.25, 0, 0.75, 0.5}, {Layer::kElevation});
  ASSERT_TRUE(placed.ok()) << placed.status();
  EXPECT_EQ(placed->origin, (CellIndex{-1, 0}));
  EXPECT_EQ(placed->grid.columns, 2);
  EXPECT_EQ(placed->grid.rows, 1);
  EXPECT_THAT(placed->grid.Find(Layer::kElevation)->valid, ElementsAre(0, 1));
}

TEST(Join, SaysWhenNothingIsKnown) {
  EXPECT_TRUE(absl::IsNotFound(Join(MapOf({}), std::nullopt, {Layer::kElevation}).status()));
  const TiledMap map = MapOf({TileWith({0, 0}, {{0, 0}})});
  EXPECT_THAT(
      std::string(Join(map, Region{50, 50, 60, 60}, {Layer::kElevation}).status().message()),
      HasSubstr("no cell of the region is known"));
}

TEST(Join, RefusesMoreCellsThanItsLimit) {
  const TiledMap map = MapOf({TileWith({0, 0}, {{0, 0}}), TileWith({100, 100}, {{12800, 12800}})});
  const absl::Status status = Join(map, std::nullopt, {Layer::kElevation}).status();
  EXPECT_TRUE(absl::IsResourceExhausted(status));
  EXPECT_THAT(std::string(status.message()),
              HasSubstr("12801 x 12801 cells, want at most 134217728: choose a region"));
}

TEST(CellsOf, RefusesARegionWithoutCells) {
  EXPECT_THAT(std::string(CellsOf({5, 0, 4, 1}, 0.5).status().message()),
              HasSubstr("region is 5,0,4,1, want X0 < X1"));
  EXPECT_THAT(std::string(CellsOf({0, 0, 2e6, 1}, 0.5).status().message()),
              HasSubstr("region holds 2e+06"));
  EXPECT_FALSE(CellsOf({0, 0, std::numeric_limits<double>::quiet_NaN(), 1}, 0.5).ok());
}

}  // namespace
}  // namespace gem::client
