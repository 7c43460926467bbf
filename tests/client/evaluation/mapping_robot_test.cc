#include "client/evaluation/mapping_robot.h"

#include <gtest/gtest.h>

#include <vector>

namespace gem::evaluation {
namespace {

constexpr std::int64_t kSecond_ns = 1'000'000'000;

// A patch of ground 1 m below the sensor, a point in the middle of each 0.2 m cell about the robot.
std::vector<ScanPoint> Patch() {
  std::vector<ScanPoint> points;
  for (int x = -10; x < 10; ++x)
    for (int y = -10; y < 10; ++y)
      points.push_back(
          {0.2f * static_cast<float>(x) + 0.1f, 0.2f * static_cast<float>(y) + 0.1f, -1.0f});
  return points;
}

RobotSetup DefaultSetup() {
  RobotSetup setup;
  setup.noise = *MakeNoiseModel(LidarNoise{});
  return setup;
}

TEST(MappingRobot, PutsEverythingItSawIntoTheMap) {
  auto robot = *MappingRobot::Make(DefaultSetup());
  const std::vector<ScanPoint> points = Patch();
  for (int i = 0; i < 30; ++i) {
    const ScanReport report = robot->Fuse(
        (i + 1) * kSecond_ns, {Eigen::Quaterniond::Identity(), {2.0 * i, 0, 0}}, points);
    EXPECT_EQ(report.points, points.size());
  }
  robot->End();
  // 29 steps of 10 cells and a patch of 20x20.
  EXPECT_EQ(robot->snapshot()->num_points, (290u + 20u) * 20u);
}

TEST(MappingRobot, ACorrectionMovesWhatWasMapped) {
  auto robot = *MappingRobot::Make(DefaultSetup());
  const std::vector<ScanPoint> points = Patch();
  robot->Fuse(kSecond_ns, {}, points);
  robot->Fuse(2 * kSecond_ns, {Eigen::Quaterniond::Identity(), {30, 0, 0}}, points);
  robot->Commit(/*show_local=*/true);
  ASSERT_TRUE(robot->Correct({{kSecond_ns, {Eigen::Quaterniond::Identity(), {0, 0, 5}}}}).ok());
  EXPECT_GT(robot->Commit(true).num_moved_submaps, 0u);
  for (const auto& [index, tile] : robot->snapshot()->tiles)
    for (const CellBelief& cell : tile->cells)
      if (cell.known()) {
        EXPECT_NEAR(cell.elevation_m, 4.0f, 1e-3f);
      }
}

TEST(MappingRobot, RefusesBadOptionsByName) {
  RobotSetup setup = DefaultSetup();
  setup.local.cell_size_m = -1;
  EXPECT_FALSE(MappingRobot::Make(setup).ok());
}

}  // namespace
}  // namespace gem::evaluation
