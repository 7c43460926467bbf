#include "client/evaluation/cyclist.h"

#include <gtest/gtest.h>

namespace gem::evaluation {
namespace {

// From (-2, 0) to (2, 0), and a post at (1.1, 0.1).
SweptPath StraightPath() {
  SweptPath path;
  path.track_m = {{-2, 0}, {2, 0}};
  path.standing_m = {1.1, 0.1};
  path.standing_reach_m = 0.15;
  return path;
}

TEST(SweptPath, CoversHalfItsWidthToEitherSide) {
  EXPECT_TRUE(StraightPath().Covers({0, 0.49}));
  EXPECT_TRUE(StraightPath().Covers({-2.3, 0.3}));
  EXPECT_FALSE(StraightPath().Covers({0, -0.51}));
  EXPECT_FALSE(StraightPath().Covers({2.6, 0}));
}

TEST(CountSwept, TellsTrailFromKerbPostAndGround) {
  LocalMap map;
  map.origin = {-20, -20};
  map.side_cells = 40;
  map.cell_size_m = 0.2f;
  map.traversability_free = 0.7f;
  map.ResizeLayers(1600);
  const auto set = [&](CellIndex cell, float elevation_m, float traversability, int state) {
    const std::size_t index = map.IndexOf(cell);
    map.elevation_m[index] = elevation_m;
    map.traversability[index] = traversability;
    map.state[index] = static_cast<std::uint8_t>(state);
  };
  set({0, 0}, 0.1f, 0.9f, kCellKnown | kCellAnnotated);   // ground
  set({1, 0}, 0.15f, 0.2f, kCellKnown | kCellAnnotated);  // kerb
  set({2, 0}, 1.2f, 0.2f, kCellKnown | kCellAnnotated);   // trail
  set({3, 0}, 1.2f, 0.0f, kCellKnown);                    // trail, too few neighbours
  set({5, 0}, 0.7f, 0.1f, kCellKnown | kCellAnnotated);   // post
  set({2, 9}, 1.2f, 0.2f, kCellKnown | kCellAnnotated);   // beside the path
  const SweptCells count = CountSwept(map, StraightPath());
  EXPECT_EQ(count.known, 5);
  EXPECT_EQ(count.obstacles, 4);
  EXPECT_EQ(count.trail, 2);
  EXPECT_EQ(count.standing, 1);
}

TEST(AddCyclist, SaysThatItNeedsData) {
  Report report;
  ASSERT_TRUE(AddCyclist(Settings(), report).ok());
  EXPECT_TRUE(report.figures.empty());
  EXPECT_EQ(report.skipped, std::vector<std::string>{"kitti_raw_0001: no --data"});
}

}  // namespace
}  // namespace gem::evaluation
