#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <vector>

#include "client/simulation/drift.h"
#include "client/simulation/path.h"

namespace gem {
namespace {

constexpr double kPi = std::numbers::pi;

TEST(Path, StraightLegIsMeasuredByItsLength) {
  const Path path({{1, 1}, {4, 5}}, 2);
  EXPECT_DOUBLE_EQ(path.length_m(), 5.0);
  EXPECT_LT((path.At(2.5).place_m - Eigen::Vector2d(2.5, 3)).norm(), 1e-12);
  EXPECT_NEAR(path.At(2.5).yaw_rad, std::atan2(4, 3), 1e-12);
}

TEST(Path, CornerBecomesAnArc) {
  // 10 m east, then 10 m north, rounded by a quarter of a circle of 2 m.
  const Path path({{0, 0}, {10, 0}, {10, 10}}, 2);
  EXPECT_NEAR(path.length_m(), 8 + kPi + 8, 1e-12);
  const PathPose middle = path.At(8 + kPi / 2);
  EXPECT_NEAR(middle.place_m.x(), 8 + 2 * std::sin(kPi / 4), 1e-12);
  EXPECT_NEAR(middle.place_m.y(), 2 - 2 * std::cos(kPi / 4), 1e-12);
  EXPECT_NEAR(middle.yaw_rad, kPi / 4, 1e-12);
  EXPECT_LT((path.At(path.length_m()).place_m - Eigen::Vector2d(10, 10)).norm(), 1e-12);
}

TEST(Path, NeitherPlaceNorHeadingJumps) {
  const Path path({{0, 0}, {10, 0}, {10, 10}, {0, 10}, {0, 2}, {6, 4}}, 3);
  for (double way_m = 0; way_m < path.length_m(); way_m += 0.01) {
    const PathPose a = path.At(way_m);
    const PathPose b = path.At(way_m + 0.01);
    EXPECT_NEAR((b.place_m - a.place_m).norm(), 0.01, 1e-5);
    EXPECT_LT(std::abs(std::remainder(b.yaw_rad - a.yaw_rad, 2 * kPi)), 0.01);
  }
}

TEST(Path, CornerOfShortLegsIsRoundedByASmallerArc) {
  // Half a leg of 2 m is 1 m: the arc of 1 m, not of 5.
  const Path path({{0, 0}, {2, 0}, {2, 2}}, 5);
  EXPECT_NEAR(path.length_m(), 1 + kPi / 2 + 1, 1e-12);
}

Pose<Global, Base> Truth(double way_m) {
  return Pose<Global, Base>::FromYaw(0.3, {way_m * std::cos(0.3), way_m * std::sin(0.3), 1.0});
}

TEST(Odometry, WithoutDriftIsTheTruthToTheBit) {
  Odometry odometry({}, {}, 1);
  for (double way_m = 0; way_m < 50; way_m += 0.37) {
    const Pose<Global, Base> T_G_B = Truth(way_m);
    const Pose<Odom, Base> T_O_B = odometry.Advance(way_m, T_G_B);
    EXPECT_EQ(T_O_B.translation(), T_G_B.translation());
    EXPECT_EQ(T_O_B.rotation().coeffs(), T_G_B.rotation().coeffs());
  }
}

TEST(Odometry, BiasGrowsWithTheWay) {
  Odometry odometry({.forward_m_per_m = 0.01, .height_m_per_m = 0.002}, {}, 1);
  Pose<Odom, Base> T_O_B;
  for (int i = 0; i <= 200; ++i) T_O_B = odometry.Advance(0.5 * i, Truth(0.5 * i));
  // 1 m too far and 0.2 m too high after 100 m.
  const Eigen::Vector3d error_m = T_O_B.translation() - Truth(100).translation();
  EXPECT_NEAR(error_m.x(), std::cos(0.3), 1e-9);
  EXPECT_NEAR(error_m.y(), std::sin(0.3), 1e-9);
  EXPECT_NEAR(error_m.z(), 0.2, 1e-9);
}

TEST(Odometry, YawBiasBendsTheWay) {
  // 0.01 rad a metre: 100 m straight become an arc of radius 100 m and 1 rad.
  Odometry odometry({.yaw_rad_per_m = 0.01}, {}, 1);
  Pose<Odom, Base> T_O_B;
  for (int i = 0; i <= 10'000; ++i) {
    T_O_B = odometry.Advance(0.01 * i, Pose<Global, Base>::FromTranslation(0.01 * i, 0, 0));
  }
  EXPECT_NEAR(T_O_B.translation().x(), 100 * std::sin(1.0), 0.01);
  EXPECT_NEAR(T_O_B.translation().y(), 100 * (1 - std::cos(1.0)), 0.01);
}

TEST(Odometry, RandomWalkGrowsWithTheRootOfTheWay) {
  double sum2_m2 = 0;
  for (std::uint64_t seed = 0; seed < 400; ++seed) {
    Odometry odometry({.height_walk_m = 0.1}, {}, seed);
    Pose<Odom, Base> T_O_B;
    for (int i = 0; i <= 25; ++i) T_O_B = odometry.Advance(i, Truth(i));
    sum2_m2 += std::pow(T_O_B.translation().z() - 1.0, 2);
  }
  // sigma 0.1 sqrt(25) = 0.5; of 400 drawn, known to 3.5 %.
  EXPECT_NEAR(std::sqrt(sum2_m2 / 400), 0.5, 4 * 0.035 * 0.5);
}

TEST(Odometry, SameSeedDriftsAlike) {
  const DriftRates rates = {.position_walk_m = 0.1, .yaw_walk_rad = 0.01};
  Odometry a(rates, {}, 5), b(rates, {}, 5), c(rates, {}, 6);
  a.Advance(0, Truth(0));
  b.Advance(0, Truth(0));
  c.Advance(0, Truth(0));
  const Pose<Odom, Base> T_O_B = a.Advance(10, Truth(10));
  EXPECT_EQ(T_O_B.translation(), b.Advance(10, Truth(10)).translation());
  EXPECT_NE(T_O_B.translation(), c.Advance(10, Truth(10)).translation());
}

TEST(Odometry, JumpsDisplaceWhatComesAfterThemAndNothingElse) {
  Odometry odometry({}, {{.way_m = 10, .shift_m = {1.2, -0.6, 0.1}}}, 1);
  EXPECT_EQ(odometry.Advance(9.9, Truth(9.9)).translation(), Truth(9.9).translation());
  for (const double way_m : {10.0, 15.0, 30.0}) {
    const Eigen::Vector3d error_m =
        odometry.Advance(way_m, Truth(way_m)).translation() - Truth(way_m).translation();
    EXPECT_LT((error_m - Eigen::Vector3d(1.2, -0.6, 0.1)).norm(), 1e-12);
  }
}

TEST(Odometry, JumpTurnsAboutTheRobot) {
  Odometry odometry({}, {{.way_m = 10, .yaw_rad = kPi / 2}}, 1);
  const auto at = [](double x) { return Pose<Global, Base>::FromTranslation(x, 0, 0); };
  odometry.Advance(0, at(0));
  EXPECT_LT((odometry.Advance(10, at(10)).translation() - Eigen::Vector3d(10, 0, 0)).norm(), 1e-12);
  // 5 m on to the east are 5 m to the north now.
  EXPECT_LT((odometry.Advance(15, at(15)).translation() - Eigen::Vector3d(10, 5, 0)).norm(), 1e-12);
}

}  // namespace
}  // namespace gem
