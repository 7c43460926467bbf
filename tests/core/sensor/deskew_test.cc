#include "core/sensor/deskew.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <random>

namespace gem {
namespace {

constexpr std::int64_t kStamp_ns = 10'000'000'000;
constexpr std::int64_t kTenth_ns = 100'000'000;

/// Drives along x at 10 m/s and turns left at 1 rad/s while it does; a pose every `period_ns`.
Pose<Odom, Base> Driven(std::int64_t stamp_ns) {
  const double t_s = static_cast<double>(stamp_ns - kStamp_ns) * 1e-9;
  // On a circle of 10 m about (0, 10).
  return Pose<Odom, Base>::FromYaw(t_s, {10 * std::sin(t_s), 10 - 10 * std::cos(t_s), 0.3 * t_s});
}
Trajectory<Odom, Base> Drive(std::int64_t period_ns = 10'000'000) {
  Trajectory<Odom, Base> trajectory;
  for (std::int64_t t = kStamp_ns - 2 * kTenth_ns; t <= kStamp_ns + 2 * kTenth_ns; t += period_ns)
    trajectory.Append(t, Driven(t));
  return trajectory;
}

TEST(SpanOf, HoldsTheStampAndAllOffsets) {
  const TimeSpan none = SpanOf(kStamp_ns, {});
  EXPECT_EQ(none.begin_ns, kStamp_ns);
  EXPECT_EQ(none.end_ns, kStamp_ns);
  const std::vector<float> later = {0.25f, 0.0625f};
  EXPECT_EQ(SpanOf(kStamp_ns, later).begin_ns, kStamp_ns);
  EXPECT_EQ(SpanOf(kStamp_ns, later).end_ns, kStamp_ns + 250'000'000);
  const std::vector<float> earlier = {-0.5f, -0.25f};
  EXPECT_EQ(SpanOf(kStamp_ns, earlier).begin_ns, kStamp_ns - 500'000'000);
  EXPECT_EQ(SpanOf(kStamp_ns, earlier).end_ns, kStamp_ns);
}

TEST(Covers, AsksForPosesAtBothEnds) {
  const Trajectory<Odom, Base> trajectory = Drive();
  EXPECT_TRUE(Covers(trajectory, {kStamp_ns - 2 * kTenth_ns, kStamp_ns + 2 * kTenth_ns}));
  EXPECT_FALSE(Covers(trajectory, {kStamp_ns - 2 * kTenth_ns - 1, kStamp_ns}));
  EXPECT_FALSE(Covers(trajectory, {kStamp_ns, kStamp_ns + 2 * kTenth_ns + 1}));
  EXPECT_FALSE(Covers(Trajectory<Odom, Base>(), {kStamp_ns, kStamp_ns}));
}

TEST(Deskew, CarriesAPointAlongAStraightLine) {
  // 10 m/s along x. What is 5 m ahead a tenth of a second before the stamp is 4 m ahead at it.
  Trajectory<Odom, Base> straight;
  straight.Append(kStamp_ns - kTenth_ns, Pose<Odom, Base>::FromTranslation(7, 0, 0));
  straight.Append(kStamp_ns + kTenth_ns, Pose<Odom, Base>::FromTranslation(9, 0, 0));
  const std::vector<float> offsets_s = {-0.1f, 0, 0.05f};
  std::vector<ScanPoint> points(3, ScanPoint{5, 1, -1, 0xff0000ff});
  Deskew(straight, kStamp_ns, Pose<Base, Sensor>(), offsets_s, points);
  EXPECT_NEAR(points[0].x_m, 4, 1e-5);
  EXPECT_NEAR(points[1].x_m, 5, 1e-5);
  EXPECT_NEAR(points[2].x_m, 5.5, 1e-5);
  for (const ScanPoint& point : points) {
    EXPECT_NEAR(point.y_m, 1, 1e-5);
    EXPECT_NEAR(point.z_m, -1, 1e-5);
    EXPECT_EQ(point.rgba, 0xff0000ffu);
  }
}

TEST(Deskew, CarriesPointsRoundABendWithASensorThatIsMountedAskew) {
  // What stands still in O lies at one place of S(stamp), whenever it was seen.
  const Pose<Base, Sensor> T_B_S(Eigen::Quaterniond(0.8, 0.2, -0.3, 0.1).normalized(),
                                 {0.5, -0.2, 1.5});
  std::mt19937 random(1);
  std::uniform_real_distribution<double> at_m(-50, 50);
  std::uniform_real_distribution<float> at_s(-0.1f, 0.1f);
  std::vector<float> offsets_s;
  std::vector<ScanPoint> points;
  std::vector<Point<Sensor>> truth;
  for (int i = 0; i < 2000; ++i) {
    const Point<Odom> p_O(at_m(random), at_m(random), at_m(random));
    offsets_s.push_back(at_s(random));
    const auto stamp_ns = kStamp_ns + static_cast<std::int64_t>(double{offsets_s.back()} * 1e9);
    const Eigen::Vector3f p_S = ((Driven(stamp_ns) * T_B_S).Inverse() * p_O).xyz().cast<float>();
    points.push_back({p_S.x(), p_S.y(), p_S.z(), 0});
    truth.push_back((Driven(kStamp_ns) * T_B_S).Inverse() * p_O);
  }
  Deskew(Drive(), kStamp_ns, T_B_S, offsets_s, points);
  // Poses every 10 ms: their chords leave the circle by 10 m/s^2 * (10 ms)^2 / 8 = 0.1 mm.
  for (std::size_t i = 0; i < points.size(); ++i) {
    EXPECT_NEAR(points[i].x_m, truth[i].x(), 5e-4) << i;
    EXPECT_NEAR(points[i].y_m, truth[i].y(), 5e-4) << i;
    EXPECT_NEAR(points[i].z_m, truth[i].z(), 5e-4) << i;
  }
}

TEST(Deskew, NeedsOnlyRelativeMotion) {
  const std::vector<float> offsets_s = {-0.07f, 0.03f};
  const std::vector<ScanPoint> measured = {{5, 1, -1, 0}, {-20, 8, 2, 0}};
  std::vector<ScanPoint> here = measured, elsewhere = measured;
  Deskew(Drive(), kStamp_ns, Pose<Base, Sensor>(), offsets_s, here);
  const auto T_O_O2 = Pose<Odom, Odom>::FromYaw(2, {100, -50, 3});
  Trajectory<Odom, Base> moved;
  const Trajectory<Odom, Base> drive = Drive();
  for (const auto& pose : drive.poses()) moved.Append(pose.stamp_ns, T_O_O2 * pose.T_A_B);
  Deskew(moved, kStamp_ns, Pose<Base, Sensor>(), offsets_s, elsewhere);
  for (std::size_t i = 0; i < here.size(); ++i) {
    EXPECT_NEAR(here[i].x_m, elsewhere[i].x_m, 1e-5);
    EXPECT_NEAR(here[i].y_m, elsewhere[i].y_m, 1e-5);
    EXPECT_NEAR(here[i].z_m, elsewhere[i].z_m, 1e-5);
  }
}

TEST(Deskew, LeavesPointsOfOneMomentAlone) {
  std::vector<ScanPoint> points = {{1.1f, 2.2f, 3.3f, 4}};
  const std::vector<float> offsets_s = {0};
  Deskew(Drive(), kStamp_ns, Pose<Base, Sensor>(), offsets_s, points);
  EXPECT_EQ(points[0].x_m, 1.1f);
  Deskew(Drive(), kStamp_ns, Pose<Base, Sensor>(), {}, {});
}

TEST(Deskew, IsFastEnoughForAnHdl64) {
  std::vector<ScanPoint> points(130'000, ScanPoint{10, 5, -1, 0});
  std::vector<float> offsets_s(points.size());
  for (std::size_t i = 0; i < points.size(); ++i)
    offsets_s[i] = 0.1f * static_cast<float>(i) / static_cast<float>(points.size());
  const Trajectory<Odom, Base> trajectory = Drive();
  double best_ms = 1e9;
  for (int run = 0; run < 10; ++run) {
    std::vector<ScanPoint> copy = points;
    const auto begin = std::chrono::steady_clock::now();
    Deskew(trajectory, kStamp_ns, Pose<Base, Sensor>(), offsets_s, copy);
    const std::chrono::duration<double, std::milli> time = std::chrono::steady_clock::now() - begin;
    best_ms = std::min(best_ms, time.count());
  }
  RecordProperty("deskew_ms", std::to_string(best_ms));
  std::printf("deskewing 130,000 points: %.2f ms\n", best_ms);
  EXPECT_LT(best_ms, 100);  // generous: sanitizers run this, too
}

}  // namespace
}  // namespace gem
