#include "core/local/clear.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <vector>

#include "core/local/ray_table.h"
#include "tests/core/local/scenes.h"

namespace gem {
namespace {

constexpr float kCell_m = 0.2f;
constexpr float kSensor_m = 1.7f;
const RayBins kBins = RayBinsOf(40, kCell_m);

TEST(RayBins, GrowWithTheWindow) {
  EXPECT_EQ(kBins.azimuth, 1024);
  EXPECT_EQ(kBins.range, 59);  // 40 * sqrt(2) = 56.57 cells, and two
  EXPECT_EQ(RayBinsOf(160, 0.1f).azimuth, 4096);
  EXPECT_EQ(RayBinsOf(1024, 0.1f).azimuth, 4096);
}

TEST(DiamondAngle, RisesFromZeroToFour) {
  EXPECT_EQ(DiamondAngle(1, 0), 0);
  EXPECT_EQ(DiamondAngle(2, 2), 0.5f);
  EXPECT_EQ(DiamondAngle(0, 3), 1);
  EXPECT_EQ(DiamondAngle(-1, 0), 2);
  EXPECT_EQ(DiamondAngle(0, -1), 3);
  EXPECT_EQ(DiamondAngle(1, -1), 3.5f);
  float before = -1;
  for (double angle_rad = 0; angle_rad < 2 * std::numbers::pi; angle_rad += 0.001) {
    const float angle = DiamondAngle(static_cast<float>(std::cos(angle_rad)),
                                     static_cast<float>(std::sin(angle_rad)));
    EXPECT_GT(angle, before);
    before = angle;
  }
  EXPECT_EQ(AzimuthBinOf(1, -1e-12f, kBins), 1023);  // its angle rounds to 4, which is no bin
}

TEST(Ray, KnowsItsBinsAndSlope) {
  const Ray ray = RayTo(0, 3, -1.5f, kBins);
  EXPECT_EQ(ray.azimuth_bin, 256);
  EXPECT_EQ(ray.range_bin, 15);
  EXPECT_FLOAT_EQ(ray.slope, -0.5f);
  EXPECT_EQ(RayTo(0, 0, -1, kBins).range_bin, 0);
  EXPECT_EQ(RayTo(1e4f, 0, 0, kBins).range_bin, 58);
}

TEST(Sight, OfACellStraightAhead) {
  // [1, 1.2] x [-0.1, 0.1]: diamond angles +-0.1 / 1.1, that is +-23.27 of 256 bins a quarter.
  const CellSight sight = SightOf(1, -0.1f, kBins);
  EXPECT_EQ(sight.first_bin, 1024 - 23);
  EXPECT_EQ(sight.num_bins, 46);
  EXPECT_FLOAT_EQ(sight.near_m, 1.0f);
  EXPECT_NEAR(sight.far_m, std::hypot(1.2, 0.1), 1e-6);  // 1.204 m, range bin 6
  EXPECT_EQ(sight.range_bin_min, 7);
}

TEST(Sight, OfACellOffTheAxis) {
  // [-1.2, -1] x [0.6, 0.8]: from (-1, 0.8) to (-1.2, 0.6).
  const CellSight sight = SightOf(-1.2f, 0.6f, kBins);
  EXPECT_EQ(sight.first_bin, static_cast<int>(std::ceil((2 - 0.8 / 1.8) * 256)));
  EXPECT_EQ(sight.first_bin + sight.num_bins, static_cast<int>((2 - 0.6 / 1.8) * 256));
  EXPECT_NEAR(sight.near_m, std::hypot(1.0, 0.6), 1e-6);
  EXPECT_NEAR(sight.far_m, std::hypot(1.2, 0.8), 1e-6);
}

TEST(Sight, OfACellThatTouchesTheSensorIsNone) {
  EXPECT_EQ(SightOf(-0.1f, -0.1f, kBins).num_bins, 0);
  EXPECT_EQ(SightOf(0, -0.1f, kBins).num_bins, 0);
  EXPECT_EQ(SightOf(-0.2f, -0.2f, kBins).num_bins, 0);
  EXPECT_GT(SightOf(0.001f, -0.1f, kBins).num_bins, 200);  // nearly half a turn
}

TEST(Sight, OfACellBeyondTheLastRangeBinIsNone) {
  EXPECT_EQ(SightOf(11.7f, 0, kBins).num_bins, 0);
  EXPECT_GT(SightOf(11.2f, 0, kBins).num_bins, 0);
}

// Whether the half-line from the sensor in a direction given in azimuth bins meets the cell, grown
// by margin_m.
bool Meets(double bins, double x_m, double y_m, double margin_m) {
  const double angle = std::fmod(bins / 256 + 4, 4);
  const double x = angle < 2 ? 1 - angle : angle - 3;
  const double y = angle < 1 ? angle : angle < 3 ? 2 - angle : angle - 4;
  double enter = 0, leave = 1e9;
  for (const auto& [low, step] : {std::pair{x_m, x}, {y_m, y}}) {
    const double a = (low - margin_m) / step, b = (low + kCell_m + margin_m) / step;
    enter = std::max(enter, std::min(a, b));
    leave = std::min(leave, std::max(a, b));
  }
  return enter < leave;
}

TEST(Sight, IsEveryBinWhoseDirectionsAllMeetTheCell) {
  for (int row = -30; row < 30; ++row) {
    for (int column = -30; column < 30; ++column) {
      if (column == -1 && row == -1) continue;  // the sensor's own
      const float x_m = static_cast<float>(column) * kCell_m + 0.07f;
      const float y_m = static_cast<float>(row) * kCell_m + 0.03f;
      const CellSight sight = SightOf(x_m, y_m, kBins);
      ASSERT_GT(sight.num_bins, 0);
      constexpr double kRounding = 1e-3;  // of a bin, and of a metre
      const double begin = sight.first_bin, end = sight.first_bin + sight.num_bins;
      EXPECT_TRUE(Meets(begin + kRounding, x_m, y_m, kRounding)) << column << " " << row;
      EXPECT_TRUE(Meets((begin + end) / 2, x_m, y_m, kRounding)) << column << " " << row;
      EXPECT_TRUE(Meets(end - kRounding, x_m, y_m, kRounding)) << column << " " << row;
      EXPECT_FALSE(Meets(begin - 1, x_m, y_m, -kRounding)) << column << " " << row;
      EXPECT_FALSE(Meets(end + 1, x_m, y_m, -kRounding)) << column << " " << row;
    }
  }
}

bool Clears(const std::vector<Eigen::Vector3f>& ends, float x_m, float y_m, float height_m) {
  RayTable table(kBins);
  table.SetLimit(kBins.range - 1);
  table.Reset(FullTurn(kBins));
  for (const Eigen::Vector3f& end : ends) table.Add(RayTo(end.x(), end.y(), end.z(), kBins));
  table.Complete(WidestVectorSet(), FullTurn(kBins));
  return table.AllPassBelow(SightOf(x_m, y_m, kBins), kSensor_m, height_m);
}

// The original never cleared obstacles that lie along an axis of the map from the sensor.
TEST(Clear, WorksAlongTheAxes) {
  for (const auto& [x, y] : {std::pair{1, 0}, {0, 1}, {-1, 0}, {0, -1}}) {
    const float fx = static_cast<float>(x), fy = static_cast<float>(y);
    // Down to the ground 4 m away: 0.85 m high at 2 m.
    EXPECT_TRUE(Clears({{4 * fx, 4 * fy, -1.7f}}, 2 * fx - 0.1f, 2 * fy - 0.1f, 1.0f));
    EXPECT_FALSE(Clears({{-4 * fx, -4 * fy, -1.7f}}, 2 * fx - 0.1f, 2 * fy - 0.1f, 1.0f));
  }
}

TEST(Clear, NeedsTheRayBelowWhereItIsHighestInTheCell) {
  // Falling 0.425 a metre from 1.7 m: 0.8925 m high where it enters the cell at 1.9 m.
  EXPECT_TRUE(Clears({{4, 0, -1.7f}}, 1.9f, -0.1f, 0.893f));
  EXPECT_FALSE(Clears({{4, 0, -1.7f}}, 1.9f, -0.1f, 0.892f));
  // Rising 0.1 a metre: 1.9103 m high at the farthest corner, hypot(2.1, 0.1) m away.
  EXPECT_TRUE(Clears({{4, 0, 0.4f}}, 1.9f, -0.1f, 1.911f));
  EXPECT_FALSE(Clears({{4, 0, 0.4f}}, 1.9f, -0.1f, 1.910f));
}

TEST(Clear, NeedsTheRayToEndBeyondTheCell) {
  // The farthest corner lies at 2.1024 m, in range bin 10: an end at 2.2 m is in the next.
  EXPECT_FALSE(Clears({{2.0f, 0, -1.0f}}, 1.9f, -0.1f, 1.6f));
  EXPECT_FALSE(Clears({{2.19f, 0, -1.0f}}, 1.9f, -0.1f, 1.6f));
  EXPECT_TRUE(Clears({{2.21f, 0, -1.0f}}, 1.9f, -0.1f, 1.6f));
}

TEST(Clear, ARayBesideTheCellSaysNothing) {
  EXPECT_FALSE(Clears({{4, 0.22f, -1.7f}}, 1.9f, -0.1f, 1.5f));   // leaves through the side
  EXPECT_FALSE(Clears({{4, -0.30f, -1.7f}}, 1.9f, -0.1f, 1.5f));  // misses it
  EXPECT_TRUE(Clears({{4, 0.18f, -1.7f}}, 1.9f, -0.1f, 1.5f));
}

TEST(Clear, IsRefusedIfSomethingMayStillStandInPartOfTheCell) {
  // On the left of the cell the lowest ray that gets past it passes above its height, ends in the
  // cell, or ends before it.
  EXPECT_FALSE(Clears({{4, -0.1f, -1.7f}, {4, 0.15f, 0}}, 1.9f, -0.1f, 1.5f));
  EXPECT_FALSE(Clears({{4, -0.1f, -1.7f}, {2, 0.08f, -1.0f}}, 1.9f, -0.1f, 1.5f));
  EXPECT_FALSE(Clears({{4, -0.1f, -1.7f}, {1, 0.04f, -0.1f}}, 1.9f, -0.1f, 1.5f));
  // The same rays in the same direction as a low one that goes on say nothing.
  EXPECT_TRUE(Clears({{4, -0.1f, -1.7f}, {4, -0.1f, 0}}, 1.9f, -0.1f, 1.5f));
  EXPECT_TRUE(Clears({{4, -0.1f, -1.7f}, {1, -0.025f, -1.6f}}, 1.9f, -0.1f, 1.5f));
}

TEST(ClearHeight, IsWhatTheCellSurelyReaches) {
  const LocalMapOptions options;
  EXPECT_FLOAT_EQ(ClearHeightOf(1.0f, 1e-4f, false, options), 0.97f);
  // A free cell must be passed critically deep below: 0.2 m, or 3 sigma if that is more.
  EXPECT_FLOAT_EQ(ClearHeightOf(1.0f, 1e-4f, true, options), 0.8f);
  EXPECT_FLOAT_EQ(ClearHeightOf(1.0f, 0.01f, true, options), 0.7f);
}

// Exact geometry in double: the highest place of the ray inside the square, if it crosses it and
// ends beyond it; infinity if it does not.
double ExactTop(const Eigen::Vector3f& end, double x0, double y0, double side_m, double sensor_m) {
  double enter = 0, leave = 1;  // fractions of the ray
  const double min[2] = {x0, y0};
  for (int axis = 0; axis < 2; ++axis) {
    const double step = end(axis);
    if (step == 0) {
      if (min[axis] > 0 || min[axis] + side_m < 0) return std::numeric_limits<double>::infinity();
      continue;
    }
    double a = min[axis] / step, b = (min[axis] + side_m) / step;
    if (a > b) std::swap(a, b);
    enter = std::max(enter, a);
    leave = std::min(leave, b);
  }
  // leave == 1 means that the ray ends inside.
  if (enter >= leave || leave >= 1) return std::numeric_limits<double>::infinity();
  return sensor_m + std::max(enter * end.z(), leave * end.z());
}

TEST(Clear, NeverClearsACellThatNoRayPassesBelow) {
  std::mt19937 random(11);
  std::uniform_real_distribution<float> place_m(-8, 8), height_m(-1.7f, 0.6f), top_m(0.2f, 2.2f);
  int cleared = 0;
  for (int trial = 0; trial < 4000; ++trial) {
    std::vector<Eigen::Vector3f> ends;
    for (int i = 0; i < 40; ++i)
      ends.emplace_back(place_m(random), place_m(random), height_m(random));
    const float x_m = place_m(random) / 2, y_m = place_m(random) / 2, h_m = top_m(random);
    if (!Clears(ends, x_m, y_m, h_m)) continue;
    ++cleared;
    double lowest_m = std::numeric_limits<double>::infinity();
    for (const auto& end : ends) {
      lowest_m = std::min(lowest_m, ExactTop(end, x_m, y_m, kCell_m, kSensor_m));
    }
    EXPECT_LT(lowest_m, h_m + 1e-5);
  }
  EXPECT_GT(cleared, 200);
}

TEST(Clear, FindsNearlyAllCellsThatExactGeometryClears) {
  // A LiDAR on flat ground; each cell of the window in turn is believed to hold a ghost.
  testing::World world;
  testing::Lidar lidar;
  std::mt19937 random(3);
  const auto points = lidar.Sweep(world, Pose<Odom, Sensor>::FromTranslation(0, 0, 1.7), random);
  RayTable table(kBins);
  table.SetLimit(kBins.range - 1);
  table.Reset(FullTurn(kBins));
  std::vector<Eigen::Vector3f> ends;
  for (const ScanPoint& p : points) {
    ends.emplace_back(p.x_m, p.y_m, p.z_m);
    table.Add(RayTo(p.x_m, p.y_m, p.z_m, kBins));
  }
  table.Complete(WidestVectorSet(), FullTurn(kBins));
  int exact = 0, found = 0;
  for (const float ghost_m : {0.3f, 0.8f, 1.6f}) {
    for (int row = -20; row < 20; row += 3) {
      for (int column = -20; column < 20; ++column) {
        const float x_m = static_cast<float>(column) * kCell_m + 0.05f;
        const float y_m = static_cast<float>(row) * kCell_m + 0.11f;
        const bool clears_exactly = std::any_of(ends.begin(), ends.end(), [&](const auto& end) {
          return ExactTop(end, x_m, y_m, kCell_m, kSensor_m) < ghost_m;
        });
        const bool clears = table.AllPassBelow(SightOf(x_m, y_m, kBins), kSensor_m, ghost_m);
        exact += clears_exactly;
        found += clears && clears_exactly;
        EXPECT_TRUE(clears_exactly || !clears);
      }
    }
  }
  EXPECT_GT(exact, 500);
  EXPECT_GE(found, 0.95 * exact) << found << " of " << exact;
}

}  // namespace
}  // namespace gem
