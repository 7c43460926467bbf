#include "client/evaluation/crowd_tally.h"

#include <gtest/gtest.h>

#include <memory>
#include <vector>

#include "client/evaluation/crowd.h"
#include "client/simulation/analytic_terrain.h"

namespace gem::evaluation {
namespace {

const Eigen::Vector3d kSensor_m(0, 0, 1.7);

// A cube at (1.1, 1.1), and somebody who walks from (-1.1, -1.1) straight up at 1 m/s.
World CubeAndWalker() {
  World world(
      std::make_unique<AnalyticTerrain>(GroundPlane{}, std::vector<Hill>{}, std::vector<Step>{}));
  world.Add(MakeBox({1.1, 1.1}, {0.5, 0.5}, 0, 0, 0.5));
  Walker walker;
  walker.path_m = {{-1.1, -1.1}, {-1.1, 8.9}};
  walker.speed_m_per_s = 1;
  world.Add(walker);
  return world;
}

// 40 x 40 known cells of 0.2 m about the origin, all at 0 but for the named ones at 0.5 m.
LocalMap MapWithHigh(const std::vector<CellIndex>& high) {
  LocalMap map;
  map.origin = {-20, -20};
  map.side_cells = 40;
  map.cell_size_m = 0.2f;
  map.ResizeLayers(1600);
  map.state.assign(1600, kCellKnown);
  map.elevation_m.assign(1600, 0.0f);
  for (const CellIndex cell : high) map.elevation_m[map.IndexOf(cell)] = 0.5f;
  return map;
}

constexpr CellIndex kOnWalker{-6, -6};  // middle at (-1.1, -1.1)
constexpr CellIndex kOnCube{5, 5};      // middle at (1.1, 1.1)

TEST(CrowdTally, CountsWhatAWalkerLeavesBehind) {
  const World world = CubeAndWalker();
  CrowdTally cleared(world, 0.2), trail(world, 0.2);
  for (CrowdTally* tally : {&cleared, &trail}) tally->Add(MapWithHigh({kOnWalker}), kSensor_m, 0);
  EXPECT_EQ(cleared.Count().walked, 1);
  EXPECT_EQ(cleared.Count().revealed, 0) << "he is still there";
  cleared.Add(MapWithHigh({}), kSensor_m, 3);
  EXPECT_EQ(cleared.Count().revealed, 1);
  EXPECT_EQ(cleared.Count().seen, 1);
  EXPECT_EQ(cleared.Count().trails, 0);
  trail.Add(MapWithHigh({kOnWalker}), kSensor_m, 3);
  EXPECT_EQ(trail.Count().trails, 1);
  EXPECT_EQ(trail.Count().seen_trails, 1);
  EXPECT_EQ(trail.by_scan().back().seen_trails, 1);
}

TEST(CrowdTally, DoesNotBlameTheMapForWhatIsHidden) {
  const World world = CubeAndWalker();
  CrowdTally tally(world, 0.2);
  tally.Add(MapWithHigh({kOnWalker}), kSensor_m, 0);
  // He is gone, but the cube stands between the sensor and where he was.
  tally.Add(MapWithHigh({kOnWalker}), {3.3, 3.3, 1.7}, 3);
  EXPECT_EQ(tally.Count().revealed, 0);
  EXPECT_EQ(tally.Count().hidden_trails, 1);
  EXPECT_EQ(tally.Count().trails, 0);
}

TEST(CrowdTally, CountsLostCellsThingsAndGround) {
  const World world = CubeAndWalker();
  CrowdTally tally(world, 0.2);
  tally.Add(MapWithHigh({kOnCube}), kSensor_m, 0);
  EXPECT_EQ(tally.Count().standing, 1);
  EXPECT_EQ(tally.Count().standing_lost, 0);
  EXPECT_EQ(tally.Count().things, 1);
  EXPECT_GT(tally.Count().ground, 1000);
  // The cube is forgotten, and something appears where nothing is.
  tally.Add(MapWithHigh({{12, -12}}), kSensor_m, 0.1);
  EXPECT_EQ(tally.Count().standing_lost, 1);
  EXPECT_EQ(tally.Count().things_lost, 1);
  EXPECT_EQ(tally.Count().ground_lost, 1);
  EXPECT_EQ(tally.Count().edges_lost, 0);
}

TEST(CrowdTally, AddsUp) {
  CrowdTally::Counts sum{.walked = 1, .seen = 2};
  sum += {.walked = 10, .trails = 5, .seen = 20, .ground_lost = 7};
  EXPECT_EQ(sum.walked, 11);
  EXPECT_EQ(sum.trails, 5);
  EXPECT_EQ(sum.seen, 22);
  EXPECT_EQ(sum.ground_lost, 7);
}

TEST(MakeCrowd, KeepsWalkersOffThingsAndTheRobot) {
  const auto source = *MakeCrowd(1, 20);
  const World& world = source->world();
  EXPECT_EQ(world.walkers().size(), 30u);
  EXPECT_EQ(world.boxes().size() + world.cylinders().size(), 26u);
  for (const SimulatedPose& pose : source->poses()) {
    for (std::size_t i = 0; i < world.walkers().size(); ++i) {
      const Cylinder body = world.WalkerAt(i, SimulatedSource::WorldTime(pose.stamp_ns));
      EXPECT_EQ(world.TrueHeightAt(body.center_m.x(), body.center_m.y()), 0.0);
      EXPECT_GE((body.center_m - pose.T_G_B.translation().head<2>()).norm(), 1.0);
    }
  }
}

TEST(AddCrowd, ReportsBothCellSizes) {
  Settings settings;
  settings.scale = 0.1;
  Report report;
  ASSERT_TRUE(AddCrowd(settings, report).ok());
  EXPECT_EQ(report.figures.size(), 10u);
  ASSERT_EQ(report.tables.size(), 1u);
  for (const auto& row : report.tables[0].rows)
    EXPECT_EQ(row.size(), report.tables[0].columns.size());
  EXPECT_EQ(report.plots.size(), 1u);
}

}  // namespace
}  // namespace gem::evaluation
