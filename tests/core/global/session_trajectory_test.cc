#include <gtest/gtest.h>

#include <cmath>

#include "core/global/correction.h"

namespace gem {
namespace {

Pose<Odom, Base> At(double x_m) { return Pose<Odom, Base>::FromTranslation(x_m, 0, 0); }
Pose<Global, Base> CorrectedTo(double x_m, double y_m) {
  return Pose<Global, Base>::FromTranslation(x_m, y_m, 0);
}

/// Drives along x, 1 m per stamp of 100.
SessionTrajectory Drive(int last, const Pose<Global, Odom>& T_G_O = {}) {
  SessionTrajectory trajectory(T_G_O, 1000);
  for (int i = 0; i <= last; ++i) trajectory.AppendOdometry(100 * i, At(i));
  return trajectory;
}

TEST(SessionTrajectory, AnswersTheOpeningsPoseBeforeTheFirstCorrection) {
  const auto T_G_O = Pose<Global, Odom>::FromYaw(M_PI / 2, {1, 2, 3});
  const SessionTrajectory trajectory = Drive(5, T_G_O);
  EXPECT_EQ(trajectory.T_G_O(250).translation(), Eigen::Vector3d(1, 2, 3));
  EXPECT_TRUE(trajectory.T_G_O(250).matrix().isApprox(T_G_O.matrix(), 1e-11));
}

TEST(SessionTrajectory, InterpolatesBetweenTheStampsOfACorrection) {
  SessionTrajectory trajectory = Drive(10);
  // 1 m to the left at stamp 200, 3 m at 600.
  const CorrectionCounts counts =
      trajectory.SetCorrection({{200, CorrectedTo(2, 1)}, {600, CorrectedTo(6, 3)}});
  EXPECT_EQ(counts.num_used, 2u);
  EXPECT_EQ(trajectory.T_G_O(400).translation(), Eigen::Vector3d(0, 2, 0));
  EXPECT_EQ(trajectory.T_G_O(300).translation(), Eigen::Vector3d(0, 1.5, 0));
}

TEST(SessionTrajectory, AppliesTheNearestCorrectionRigidlyOutsideOfItsRange) {
  SessionTrajectory trajectory = Drive(10);
  trajectory.SetCorrection({{200, CorrectedTo(2, 1)}, {600, CorrectedTo(6, 3)}});
  EXPECT_EQ(trajectory.T_G_O(0).translation().y(), 1);
  EXPECT_EQ(trajectory.T_G_O(1000).translation().y(), 3);
  EXPECT_EQ(trajectory.T_G_O(-500).translation().y(), 1);
}

TEST(SessionTrajectory, PosesAreMatchedByStampAndNotByPosition) {
  // SLAM sends keyframes: every third pose.
  SessionTrajectory trajectory = Drive(9);
  trajectory.SetCorrection(
      {{0, CorrectedTo(0, 0)}, {300, CorrectedTo(3, 0.5)}, {900, CorrectedTo(9, 2)}});
  EXPECT_EQ(trajectory.T_G_O(300).translation(), Eigen::Vector3d(0, 0.5, 0));
  EXPECT_EQ(trajectory.T_G_O(900).translation(), Eigen::Vector3d(0, 2, 0));
}

TEST(SessionTrajectory, InterpolatesAboutTheRobotAndNotAboutTheOrigin) {
  // 1 km out, the corrections turn the world about the robot by 0 and by 0.1 rad: in between, the
  // robot stays where it is. Interpolating the translation of C would move it by 1.25 m.
  SessionTrajectory trajectory(Pose<Global, Odom>{}, 1000);
  trajectory.AppendOdometry(0, At(1000));
  trajectory.AppendOdometry(100, At(1000));
  trajectory.SetCorrection(
      {{0, CorrectedTo(1000, 0)}, {100, Pose<Global, Base>::FromYaw(0.1, {1000, 0, 0})}});
  const Point<Global> p_G = trajectory.T_G_O(50) * Point<Odom>(1000, 0, 0);
  EXPECT_NEAR((p_G.xyz() - Eigen::Vector3d(1000, 0, 0)).norm(), 0, 2e-9);
  const Eigen::AngleAxisd turn(trajectory.T_G_O(50).rotation());
  EXPECT_NEAR(turn.angle(), 0.05, 1e-10);
}

TEST(SessionTrajectory, StampsAheadAreKeptUntilOdometryReachesThem) {
  SessionTrajectory trajectory = Drive(4);
  const CorrectionCounts counts =
      trajectory.SetCorrection({{400, CorrectedTo(4, 1)}, {650, CorrectedTo(6.5, 2)}});
  EXPECT_EQ(counts.num_used, 1u);
  EXPECT_EQ(counts.num_ahead, 1u);
  EXPECT_EQ(trajectory.T_G_O(600).translation().y(), 1);
  trajectory.AppendOdometry(500, At(5));
  trajectory.AppendOdometry(600, At(6));
  EXPECT_EQ(trajectory.T_G_O(600).translation().y(), 1) << "650 is still ahead";
  trajectory.AppendOdometry(700, At(7));
  // Odometry at 650 lies half-way between two poses: 6.5 m.
  EXPECT_EQ(trajectory.T_G_O(650).translation(), Eigen::Vector3d(0, 2, 0));
}

TEST(SessionTrajectory, ACorrectionThatLiesAheadDoesNotUndoTheEarlierOneMeanwhile) {
  SessionTrajectory trajectory = Drive(4);
  trajectory.SetCorrection({{0, CorrectedTo(0, 1)}});
  EXPECT_EQ(trajectory.SetCorrection({{500, CorrectedTo(5, 7)}}).num_ahead, 1u);
  EXPECT_EQ(trajectory.T_G_O(100).translation().y(), 1);
  trajectory.AppendOdometry(500, At(5));
  EXPECT_EQ(trajectory.T_G_O(100).translation().y(), 7) << "and then it replaces it";
}

TEST(SessionTrajectory, ACorrectionBeforeTheFirstOdometryWaitsForIt) {
  SessionTrajectory trajectory(Pose<Global, Odom>{}, 100);
  trajectory.SetCorrection({{50, CorrectedTo(0, 9)}, {100, CorrectedTo(1, 2)}});
  trajectory.AppendOdometry(100, At(1));
  EXPECT_EQ(trajectory.T_G_O(100).translation().y(), 2) << "50 lies before the session";
}

TEST(SessionTrajectory, StampsBeforeTheSessionAreIgnored) {
  SessionTrajectory trajectory = Drive(4);
  const CorrectionCounts counts =
      trajectory.SetCorrection({{-100, CorrectedTo(0, 9)}, {100, CorrectedTo(1, 2)}});
  EXPECT_EQ(counts.num_ignored, 1u);
  EXPECT_EQ(counts.num_used, 1u);
  EXPECT_EQ(trajectory.T_G_O(0).translation().y(), 2);
}

TEST(SessionTrajectory, ANewCorrectionReplacesTheOldOneWhole) {
  SessionTrajectory trajectory = Drive(10);
  trajectory.SetCorrection({{0, CorrectedTo(0, 5)}, {1000, CorrectedTo(10, 5)}});
  trajectory.SetCorrection({{500, CorrectedTo(5, 1)}});
  EXPECT_EQ(trajectory.T_G_O(0).translation().y(), 1);
  EXPECT_EQ(trajectory.T_G_O(1000).translation().y(), 1);
}

TEST(SessionTrajectory, RepeatingTheOpeningsPoseRestoresItBitForBit) {
  const Pose<Global, Odom> opening(Eigen::Quaterniond(0.9, -0.1, 0.2, 0.3).normalized(),
                                   {1234.56789, -987.654321, 12.3});
  SessionTrajectory trajectory(opening, 1000);
  CorrectedTrajectory correction;
  for (int i = 0; i <= 500; ++i) {
    const Pose<Odom, Base> T_O_B =
        Pose<Odom, Base>::FromYaw(0.013 * i, {3.7 * i, 500 * std::sin(0.1 * i), 0.01 * i});
    trajectory.AppendOdometry(100 * i, T_O_B);
    correction.push_back({100 * i, opening * T_O_B});
  }
  const Pose<Global, Odom> before = trajectory.T_G_O(12345);
  trajectory.SetCorrection({{0, CorrectedTo(0, 5)}, {1000, CorrectedTo(10, 5)}});
  EXPECT_FALSE(Identical(trajectory.T_G_O(12345), before));
  trajectory.SetCorrection(correction);
  for (std::int64_t stamp_ns = -100; stamp_ns <= 50100; stamp_ns += 37)
    ASSERT_TRUE(Identical(trajectory.T_G_O(stamp_ns), before)) << stamp_ns;
}

TEST(SessionTrajectory, ARobotAtRestCostsNoMemory) {
  SessionTrajectory trajectory = Drive(3);
  for (int i = 0; i < 100000; ++i) trajectory.AppendOdometry(1000 + i, At(3));
  trajectory.AppendOdometry(200000, At(4));
  EXPECT_LE(trajectory.odometry().size(), 7u);
  EXPECT_EQ(trajectory.odometry().At(50000)->translation().x(), 3) << "and it was there all along";
}

TEST(SessionTrajectory, OdometryIsThinnedOutAtItsLimit) {
  SessionTrajectory trajectory(Pose<Global, Odom>{}, 100);
  for (int i = 0; i < 5000; ++i) {
    trajectory.AppendOdometry(100 * i, At(i));
    ASSERT_LE(trajectory.odometry().size(), 100u);
  }
  EXPECT_EQ(trajectory.odometry().front().stamp_ns, 0) << "the beginning stays";
  EXPECT_EQ(trajectory.odometry().back().stamp_ns, 499900);
  EXPECT_NEAR(trajectory.odometry().At(123450)->translation().x(), 1234.5, 1e-6);
}

/// A square piece of 3 m at x, seen when the robot was there.
SubmapPart PartAt(double x_m) {
  return {Point<Submap>(x_m, 0, 0), 0.75, 100, static_cast<std::int64_t>(100 * x_m)};
}

// Along 20 m the correction raises the way by 4 cm a metre: C at any one stamp leaves the submap
// level, and 40 cm off at one end or 20 cm at both.
TEST(SessionTrajectory, ASubmapTakesTheSlopeThatTheCorrectionHas) {
  SessionTrajectory trajectory = Drive(20);
  CorrectedTrajectory correction;
  for (int i = 0; i <= 20; ++i)
    correction.push_back({100 * i, Pose<Global, Base>::FromTranslation(i, 0, 0.04 * i)});
  trajectory.SetCorrection(correction);
  const Pose<Global, Odom> T_G_O =
      trajectory.T_G_O({PartAt(2), PartAt(6), PartAt(10), PartAt(14), PartAt(18)}, {});
  // The pieces themselves stayed level, so a little of the slope is missing.
  EXPECT_NEAR((T_G_O * Point<Odom>(10, 0, 0)).z(), 0.4, 1e-6);
  EXPECT_NEAR((T_G_O * Point<Odom>(18, 0, 0)).z(), 0.72, 0.015);
  EXPECT_NEAR((T_G_O * Point<Odom>(2, 0, 0)).z(), 0.08, 0.015);
}

// One bad pose of SLAM moves a part of the submap, not all of it.
TEST(SessionTrajectory, OneStrayPoseHardlyTurnsASubmap) {
  SessionTrajectory trajectory = Drive(20);
  CorrectedTrajectory correction;
  for (int i = 0; i <= 20; ++i) correction.push_back({100 * i, CorrectedTo(i, 0)});
  correction[2].T_A_B = Pose<Global, Base>::FromYaw(0.1, {2, 0, 0});
  trajectory.SetCorrection(correction);
  const Pose<Global, Odom> T_G_O =
      trajectory.T_G_O({PartAt(2), PartAt(6), PartAt(10), PartAt(14), PartAt(18)}, {});
  EXPECT_LT((T_G_O * Point<Odom>(18, 0, 0)).xyz().head<2>().y(), 0.02) << "by the pose: 1.6 m";
}

TEST(SessionTrajectory, ASubmapUnderOneCorrectionMovesAsItSays) {
  SessionTrajectory trajectory = Drive(20);
  const auto moved = Pose<Global, Odom>::FromYaw(0.3, {1, 2, 3});
  trajectory.SetCorrection({{0, moved * At(0)}, {2000, moved * At(20)}});
  EXPECT_TRUE(Identical(trajectory.T_G_O({PartAt(2), PartAt(18)}, {}), trajectory.T_G_O(1000)));
}

}  // namespace
}  // namespace gem
