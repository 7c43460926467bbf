#include "client/evaluation/pedestrian.h"

#include <gtest/gtest.h>

#include <memory>
#include <vector>

namespace gem::evaluation {
namespace {

TEST(CountHigh, CountsHighCellsAboutAPlace) {
  auto tile = std::make_shared<Tile>();
  tile->cells.resize(static_cast<std::size_t>(kTileCells * kTileCells));
  const auto set = [&](CellIndex cell, float elevation_m, std::uint8_t state) {
    CellBelief& belief = tile->cells[static_cast<std::size_t>(IndexInTile(cell))];
    belief.elevation_m = elevation_m;
    belief.state = state;
  };
  set({10, 10}, 1.0f, kCellKnown);  // middle at (2.1, 2.1)
  set({11, 10}, 0.5f, kCellKnown);
  set({10, 11}, 1.0f, 0);
  set({20, 10}, 1.0f, kCellKnown);
  MapSnapshot map;
  map.tiles[{0, 0}] = tile;
  EXPECT_EQ(CountHigh(map, {2.1, 2.1}, 0.5, 0.8), 1);
  EXPECT_EQ(CountHigh(map, {2.1, 2.1}, 3.0, 0.8), 2);
  EXPECT_EQ(CountHigh(map, {-9, -9}, 1.0, 0.8), 0);
}

TEST(DriveTwice, ForgetsThePedestrianAndMergesTheSubmaps) {
  PassOptions options;
  options.way_m = 30;
  const auto passes = DriveTwice(options);
  ASSERT_TRUE(passes.ok()) << passes.status();
  EXPECT_GT(passes->first.pedestrian, 4);
  EXPECT_EQ(passes->corrected.pedestrian, 0);
  EXPECT_GT(passes->corrected.pillar, 4);
  EXPECT_GT(passes->second.num_submaps, passes->first.num_submaps);
  EXPECT_EQ(passes->corrected.num_submaps, passes->first.num_submaps);
}

}  // namespace
}  // namespace gem::evaluation
