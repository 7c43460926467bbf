#include "core/geometry/trajectory.h"

#include <gtest/gtest.h>

namespace gem {
namespace {

Pose<Odom, Base> At(double x_m) { return Pose<Odom, Base>::FromTranslation(x_m, 0, 0); }

TEST(Trajectory, InterpolatesBetweenStamps) {
  Trajectory<Odom, Base> trajectory;
  trajectory.Append(100, At(0));
  trajectory.Append(200, At(10));
  EXPECT_DOUBLE_EQ(trajectory.At(125)->translation().x(), 2.5);
  EXPECT_EQ(trajectory.At(100)->translation().x(), 0);
  EXPECT_EQ(trajectory.At(200)->translation().x(), 10);
}

TEST(Trajectory, SaysNothingOutsideOfItsRange) {
  Trajectory<Odom, Base> trajectory;
  EXPECT_FALSE(trajectory.At(0).has_value());
  trajectory.Append(100, At(0));
  EXPECT_FALSE(trajectory.At(99).has_value());
  EXPECT_TRUE(trajectory.At(100).has_value());
  EXPECT_FALSE(trajectory.At(101).has_value());
}

TEST(Trajectory, DropsTheOldest) {
  Trajectory<Odom, Base> trajectory;
  for (int i = 0; i < 10; ++i) trajectory.Append(i, At(i));
  trajectory.DropOldest(20);
  EXPECT_EQ(trajectory.size(), 10u);
  trajectory.DropOldest(3);
  EXPECT_EQ(trajectory.size(), 3u);
  EXPECT_EQ(trajectory.front().stamp_ns, 7);
}

TEST(Trajectory, ThinsItsOlderHalfToEverySecondPose) {
  Trajectory<Odom, Base> trajectory;
  for (int i = 0; i < 10; ++i) trajectory.Append(i, At(i));
  trajectory.ThinOlderHalf();
  std::vector<std::int64_t> stamps;
  for (const auto& pose : trajectory.poses()) stamps.push_back(pose.stamp_ns);
  EXPECT_EQ(stamps, (std::vector<std::int64_t>{0, 2, 4, 5, 6, 7, 8, 9}));
}

TEST(TrajectoryDeathTest, StampsMustIncrease) {
  Trajectory<Odom, Base> trajectory;
  trajectory.Append(100, At(0));
  EXPECT_DEATH(trajectory.Append(100, At(1)), "check failed");
}

}  // namespace
}  // namespace gem
