#include "client/evaluation/cubes.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <vector>

namespace gem::evaluation {
namespace {

// A known map of 40 x 40 cells of 0.2 m, all at 1 m, its lower left corner at (-4, -4).
LocalMap FlatMap() {
  LocalMap map;
  map.origin = {-20, -20};
  map.side_cells = 40;
  map.cell_size_m = 0.2f;
  map.ResizeLayers(1600);
  map.state.assign(1600, kCellKnown);
  map.elevation_m.assign(1600, 1.0f);
  return map;
}

TEST(PickCubes, PicksGroupsOfHighCells) {
  LocalMap map = FlatMap();
  // Cells of x 5..7, y 5..6 touch (8, 7) at a corner; (0, 0) stands alone.
  for (const CellIndex cell : {CellIndex{5, 5}, {6, 5}, {7, 5}, {5, 6}, {6, 6}, {7, 6}, {8, 7}})
    map.elevation_m[map.IndexOf(cell)] = 1.5f;
  map.elevation_m[map.IndexOf({0, 0})] = 1.3f;
  const std::vector<PickedCube> cubes = PickCubes(map);
  ASSERT_EQ(cubes.size(), 2u);
  EXPECT_EQ(cubes[0].cells.size(), 1u);
  EXPECT_NEAR(cubes[0].height_m, 0.3, 1e-6);
  EXPECT_NEAR(cubes[0].place_m.x(), 0.1, 1e-6);
  EXPECT_EQ(cubes[1].cells.size(), 7u);
  EXPECT_NEAR(cubes[1].height_m, 0.5, 1e-6);
  EXPECT_NEAR(cubes[1].place_m.x(), (6 * 1.3 + 1.7) / 7, 1e-6);
  EXPECT_NEAR(cubes[1].place_m.y(), (3 * 1.1 + 3 * 1.3 + 1.5) / 7, 1e-6);
}

TEST(PickCubes, ReadsTheTopAndNotTheEdge) {
  LocalMap map = FlatMap();
  for (const CellIndex cell : {CellIndex{5, 5}, {6, 5}, {5, 6}, {6, 6}})
    map.elevation_m[map.IndexOf(cell)] = 1.5f;
  for (const CellIndex cell : {CellIndex{4, 4}, {5, 4}, {6, 4}, {4, 5}, {4, 6}})
    map.elevation_m[map.IndexOf(cell)] = 1.48f;
  const std::vector<PickedCube> cubes = PickCubes(map);
  ASSERT_EQ(cubes.size(), 1u);
  EXPECT_NEAR(cubes[0].height_m, 0.5, 1e-6);
  EXPECT_NEAR(cubes[0].median_height_m, 0.48, 1e-6);
}

TEST(PickCubes, DoesNotTakeWhatIsUnknownForGround) {
  LocalMap map = FlatMap();
  map.state.assign(1600, 0);
  map.elevation_m.assign(1600, 0.0f);
  EXPECT_TRUE(PickCubes(map).empty());
}

TEST(CompareCubes, ComparesHeightsAndAllDistances) {
  const std::vector<Box> truth = {MakeBox({0, 0}, {0.5, 0.5}, 0, 0, 0.5),
                                  MakeBox({3, 0}, {0.5, 0.5}, 0, 0, 0.5),
                                  MakeBox({0, 4}, {0.5, 0.5}, 0, 0, 0.5)};
  // 3 cm too high and 1 cm too low; 3.1 m apart instead of 3; one cube missed, one too many.
  const std::vector<PickedCube> picked = {{.place_m = {0, 0}, .height_m = 0.53},
                                          {.place_m = {3.1, 0}, .height_m = 0.49},
                                          {.place_m = {-3, 0}, .height_m = 0.5}};
  const CubeErrors errors = CompareCubes(picked, truth);
  EXPECT_EQ(errors.found, 2);
  EXPECT_EQ(errors.false_picks, 1);
  EXPECT_NEAR(errors.height_m, 0.02, 1e-9);
  EXPECT_NEAR(errors.distance_m, 0.1, 1e-9);
  EXPECT_TRUE(std::isnan(CompareCubes({}, truth).height_m));
}

TEST(MapAtSizes, ShowsAllCubesOfARandomScene) {
  constexpr std::array kCellSizes_m = {0.2};
  auto source = *MakeRandomCubes(7);
  const std::vector<LocalMap> maps = *MapAtSizes(*source, kCellSizes_m);
  const CubeErrors errors = CompareCubes(PickCubes(maps.at(0)), source->world().boxes());
  EXPECT_EQ(errors.found, 6);
  EXPECT_EQ(errors.false_picks, 0);
  EXPECT_LT(errors.height_m, 0.005);
  EXPECT_LT(errors.distance_m, 0.1);
}

TEST(MakeRandomCubes, GivesAnotherSceneForAnotherSeed) {
  const auto one = *MakeRandomCubes(1), again = *MakeRandomCubes(1), other = *MakeRandomCubes(2);
  EXPECT_EQ(one->world().boxes()[3].center_m, again->world().boxes()[3].center_m);
  EXPECT_NE(one->world().boxes()[3].center_m, other->world().boxes()[3].center_m);
}

}  // namespace
}  // namespace gem::evaluation
