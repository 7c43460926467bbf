// The scene `block`: streets round a city block of 60 x 40 m, x to the east, y to the north.
#include <memory>
#include <utility>

#include "client/simulation/analytic_terrain.h"
#include "client/simulation/scene_builders.h"

namespace gem {
namespace {

/// Stands `height_m` over the ground at its middle and reaches below it, so that no slope shows
/// under it.
template <typename Solid>
Solid OnGround(const World& world, Solid solid, double height_m) {
  const double ground_m = *world.ground().HeightAt(solid.center_m.x(), solid.center_m.y());
  solid.z_m_min = ground_m - 2;
  solid.z_m_max = ground_m + height_m;
  return solid;
}

void AddHouse(World& world, const Eigen::Vector2d& center_m, const Eigen::Vector2d& size_m,
              double yaw_rad = 0) {
  world.Add(OnGround(world, MakeBox(center_m, size_m, yaw_rad, 0, 1), 6.0));
}

void AddWall(World& world, const Eigen::Vector2d& from_m, const Eigen::Vector2d& to_m) {
  world.Add(OnGround(world, MakeWall(from_m, to_m, 0.3, 0, 1), 1.4));
}

void AddHouses(World& world) {
  // Inside the block, with gaps that show the yard.
  AddHouse(world, {13, 9.5}, {11, 7});
  AddHouse(world, {31, 9.0}, {9, 6}, 0.12);
  AddHouse(world, {47, 9.5}, {10, 7});
  AddHouse(world, {51, 22}, {6, 8}, -0.1);
  AddHouse(world, {47, 31}, {11, 6});
  AddHouse(world, {32, 30.5}, {10, 7});
  AddHouse(world, {12, 30.5}, {11, 7}, 0.08);
  AddHouse(world, {9, 19.5}, {5, 8});
  // Across the streets.
  AddHouse(world, {12, -9}, {12, 5});
  AddHouse(world, {69, 4}, {6, 10});
  AddHouse(world, {69, 36}, {6, 9}, 0.1);
  AddHouse(world, {42, 49}, {14, 6});
  AddHouse(world, {4, 49}, {14, 6}, -0.06);
  AddHouse(world, {-9, 14}, {6, 12});
}

void AddStreetFurniture(World& world) {
  AddWall(world, {20, -6}, {30, -6});
  AddWall(world, {30, -6}, {30, -9.5});
  AddWall(world, {20.5, 5}, {25, 5});
  AddWall(world, {37.5, 5.5}, {40.5, 5.5});
  AddWall(world, {-6, 24}, {-6, 36});
  AddWall(world, {24, 46}, {33, 46});
  for (const Eigen::Vector2d& place_m : {Eigen::Vector2d{22, -4.2},
                                         {35, -4.4},
                                         {48, -4.2},
                                         {55, -4.5},
                                         {64.3, 10},
                                         {64.5, 27},
                                         {52, 44.2},
                                         {36, 44.4},
                                         {14, 44.3},
                                         {-4.4, 39},
                                         {-4.3, 20},
                                         {-4.5, 6}}) {
    world.Add(OnGround(world, Cylinder{.center_m = place_m, .radius_m = 0.25}, 4.0));
  }
}

// Where the way begins and ends, so that an open loop shows them twice.
void AddCubes(World& world) {
  double yaw_rad = 0.2;
  for (const Eigen::Vector2d& place_m : {Eigen::Vector2d{24.3, 2.7},
                                         {27.6, -2.9},
                                         {31.2, 2.9},
                                         {34.4, -2.6},
                                         {38.1, 2.6},
                                         {41.7, -3.0}}) {
    world.Add(OnGround(world, MakeBox(place_m, {0.5, 0.5}, yaw_rad, 0, 1), 0.5));
    yaw_rad += 0.3;
  }
}

}  // namespace

Simulation BuildBlock(const SceneOptions& options) {
  // From the middle of the southern street round to where it began, and 25 m on.
  Path path({{20, 0}, {60, 0}, {60, 40}, {0, 40}, {0, 0}, {45, 0}}, 4.0);
  Simulation simulation = SimulationOn(std::move(path), 0.45, options);
  const std::vector<Hill> hills = {
      {40, 20, 10, 1.8},  // the yard
      {42, -12, 9, 2.0},  // a mound beside the start
      {60, 21, 15, 0.9},  // the eastern street climbs over it
      {72, 20, 9, 1.6},   // beside it
      {22, 54, 9, 1.8},   // north
      {0, 20, 12, 0.6},   // the western street
      {-11, 30, 8, 1.5},  // beside it
  };
  auto world = std::make_unique<World>(
      std::make_unique<AnalyticTerrain>(GroundPlane{}, hills, std::vector<Step>{}));
  AddHouses(*world);
  AddStreetFurniture(*world);
  AddCubes(*world);
  // 8 km/h: as long as the local map shows the pedestrian's place, he is on his way through it.
  simulation.robot.scan_period_s = 0.2;
  // He crosses the northern street before the robot at second 46 and walks on, out of its sight.
  world->Add(Walker{.path_m = {{23, 13.4}, {23, 75}}, .speed_m_per_s = 1.4, .start_m = 84.6});
  simulation.world = std::move(world);
  simulation.drift = DriftRatesOf(options.drift_scale);
  return simulation;
}

}  // namespace gem
