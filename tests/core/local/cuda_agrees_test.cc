// The cuda backend gives bit for bit what the cpu backend gives. Compiled twice: against the
// emulation of a device, which runs threads in whatever order, and for the device itself, if there
// is one.
#include <gtest/gtest.h>

#include <random>

#include "tests/core/local/backend_pair.h"
#include "tests/core/local/scenes.h"

namespace gem {
namespace {

using testing::Pair;
using testing::PointScan;
using testing::ShuffleThreads;
using testing::SmallWindow;

class CudaAgrees : public ::testing::Test {
 protected:
  void SetUp() override {
    const absl::Status status = CudaStatus();
    if (!status.ok()) GTEST_SKIP() << "needs a device: " << status.message();
  }
};

// A tilted robot on its way, with a tilted sensor beside it and an unsure attitude.
Scan TiltedScan(std::mt19937& random, int i) {
  std::uniform_real_distribution<double> tilt_rad(-0.2, 0.2);
  Scan scan;
  scan.seq = static_cast<std::uint64_t>(i + 1);
  scan.stamp_ns = 1'700'000'000'000'000'000 + i * std::int64_t{100'000'000};
  const double roll_rad = tilt_rad(random);
  const double pitch_rad = tilt_rad(random);
  const Eigen::Quaterniond rotation = Eigen::AngleAxisd(0.1 * i, Eigen::Vector3d::UnitZ()) *
                                      Eigen::AngleAxisd(roll_rad, Eigen::Vector3d::UnitX()) *
                                      Eigen::AngleAxisd(pitch_rad, Eigen::Vector3d::UnitY());
  scan.T_O_B = {rotation, {-3 + 0.31 * i, 2 - 0.17 * i, 100 + 0.02 * i}};
  scan.T_B_S = {Eigen::Quaterniond(Eigen::AngleAxisd(0.3, Eigen::Vector3d(1, 2, 3).normalized())),
                {0.4, -0.3, 1.5}};
  scan.rotation_covariance_rad2.diagonal() << 1e-5, 2e-5, 3e-5;
  scan.noise = testing::LidarNoiseModel();
  return scan;
}

TEST_F(CudaAgrees, OnPointsThrownAtRandom) {
  for (unsigned seed = 1; seed <= 3; ++seed) {
    ShuffleThreads(seed);
    std::mt19937 random(seed);
    std::normal_distribution<float> place_m(0, 2), height_m(-1, 0.7f);
    LocalMapOptions options = SmallWindow();
    options.body = {-0.5f, -0.5f, -1, 0.5f, 0.5f, 1};
    options.variance_growth_m2_per_s = 1e-3f;
    Pair pair(options);
    for (int i = 0; i < 6; ++i) {
      Scan scan = TiltedScan(random, i);
      std::vector<ScanPoint> points(1500 - 100 * static_cast<std::size_t>(i % 3));
      for (ScanPoint& p : points) {
        p.x_m = place_m(random);
        p.y_m = place_m(random);
        p.z_m = height_m(random);
        p.rgba = random() % 3 == 0 ? 0 : 0xff000000u | (static_cast<Rgba>(random()) & 0xffffffu);
      }
      scan.points = points;
      ASSERT_EQ(pair.Fuse(scan), "") << "seed " << seed << ", scan " << i;
    }
    EXPECT_GT(pair.evicted(), 0u);
    EXPECT_EQ(pair.EvictAll(), "");
  }
}

TEST_F(CudaAgrees, OnPackedPoints) {
  ShuffleThreads(7);
  std::mt19937 random(7);
  std::uniform_int_distribution<int> value(-900, 900);
  Pair pair(SmallWindow());
  for (int i = 0; i < 4; ++i) {
    std::vector<std::int16_t> values(3 * 1200);
    for (std::int16_t& v : values) v = static_cast<std::int16_t>(value(random));
    Scan scan = TiltedScan(random, i);
    scan.packed = {
        reinterpret_cast<const char*>(values.data()), 1200, 6, {0, 2, 4}, {0.005f, 0.005f, 0.002f}};
    ASSERT_EQ(pair.Fuse(scan), "") << "scan " << i;
  }
}

TEST_F(CudaAgrees, WhateverOrderThreadsRunIn) {
  for (unsigned seed = 10; seed < 18; ++seed) {
    ShuffleThreads(seed);
    std::mt19937 random(1);
    std::normal_distribution<float> place_m(0, 1), height_m(-1, 0.3f);
    std::vector<ScanPoint> points(500);
    for (ScanPoint& p : points) {
      p.x_m = place_m(random);
      p.y_m = place_m(random);
      p.z_m = height_m(random);
    }
    Pair pair(SmallWindow());
    for (int i = 0; i < 2; ++i) {
      Scan scan = TiltedScan(random, i);
      scan.points = points;
      ASSERT_EQ(pair.Fuse(scan), "") << "seed " << seed << ", scan " << i;
    }
  }
}

TEST_F(CudaAgrees, OnATiltedRobotThatMovesAmongBoxes) {
  ShuffleThreads(4);
  std::mt19937 random(4);
  testing::Lidar lidar;
  lidar.rings = 24;
  lidar.columns = 120;
  lidar.elevation_rad_min = -1.3;
  lidar.sigma_m = 0.02;
  testing::World world;
  world.ground_m = 98.5;
  for (int i = 0; i < 6; ++i)
    world.boxes.push_back(testing::BoxOn(-3 + i, 1.5 - 0.5 * i, 0.4, 0.3 + 0.1 * i, 98.5));
  Pair pair(SmallWindow());
  for (int i = 0; i < 10; ++i) {
    Scan scan = TiltedScan(random, i);
    if (i >= 6) world.ground_m -= 0.2;  // ground that sinks
    const std::vector<ScanPoint> points = lidar.Sweep(world, scan.T_O_B * scan.T_B_S, random);
    scan.points = points;
    ASSERT_EQ(pair.Fuse(scan), "") << "scan " << i;
  }
  EXPECT_GT(pair.evicted(), 0u);
}

TEST_F(CudaAgrees, OnAWalkerThatIsCleared) {
  ShuffleThreads(5);
  std::mt19937 random(5);
  testing::Lidar lidar;
  lidar.rings = 32;
  lidar.columns = 240;
  Pair pair(SmallWindow());
  for (int i = 0; i < 6; ++i) {
    testing::World world;
    world.boxes.push_back(testing::BoxOn(-1.5 + 0.6 * i, 1.0, 0.5, 1.2));
    world.boxes.push_back(testing::BoxOn(-1.0, -1.2, 0.4, 0.6));
    PointScan scan(1.5);
    scan.scan().noise = testing::LidarNoiseModel();
    scan.AddAll(lidar.Sweep(world, scan.scan().T_O_B * scan.scan().T_B_S, random));
    ASSERT_EQ(pair.Fuse(scan.At(static_cast<std::uint64_t>(i + 1))), "") << "scan " << i;
  }
  EXPECT_GT(pair.cleared(), 5u);
}

TEST_F(CudaAgrees, OnNastyScans) {
  ShuffleThreads(6);
  LocalMapOptions options = SmallWindow();
  options.range_m_min = 0;
  Pair pair(options);
  std::uint64_t seq = 1;
  const auto expect_same = [&](PointScan& scan, const char* what) {
    EXPECT_EQ(pair.Fuse(scan.At(seq++)), "") << what;
  };
  PointScan empty;
  expect_same(empty, "an empty first scan");
  PointScan one;
  one.Add(1, 1, 0.5);
  expect_same(one, "one point");
  PointScan origin(Pose<Odom, Base>(), {});
  origin.Add(0, 0, 0);
  expect_same(origin, "the sensor's own origin");
  PointScan one_cell;
  for (int i = 0; i < 1500; ++i) one_cell.Add(1.05, 1.05, 0.001 * (i % 997));
  expect_same(one_cell, "all points in one cell");
  PointScan borders;
  for (int y = -12; y <= 12; ++y)
    for (int x = -12; x <= 12; ++x) borders.Add(0.2 * x, 0.2 * y, 0.1 * ((x + y) & 3));
  expect_same(borders, "points on the borders of cells");
  PointScan highest;
  highest.Add(1.05, 1.05, 5).Add(-1.05, 1.05, 2).Add(-1.05, 1.05, 2);
  expect_same(highest, "cells that restart, and equal heights");
  PointScan negative(Pose<Odom, Base>::FromTranslation(-1000.1, -2000.3, -50), {});
  negative.AddCells({{-5013, -10014}, {-4989, -9990}}, 0.2,
                    [](double x, double) { return 0.1 * x + 50; });
  expect_same(negative, "negative coordinates, after a jump");
  PointScan seam(Pose<Odom, Base>::FromTranslation(-1001.9, -1998.4, -50), {});
  seam.Add(-1002.5, -1998.1, -50);
  expect_same(seam, "a move across the seam");
  PointScan huge(Pose<Odom, Base>::FromTranslation(999'999.9, -999'999.9, 900'000), {});
  huge.Add(999'998, -999'998, 900'000).AddAll({{3e38f, -3e38f, 3e38f, 0}, {1e-38f, 0, 0, 0}});
  expect_same(huge, "the far end of O");
  PointScan wall(Pose<Odom, Base>(), Pose<Base, Sensor>::FromTranslation(4, 3, 2));
  for (int i = 0; i < 900; ++i) wall.Add(2 - 0.004 * i, 2 - 0.0041 * (i % 800), 0.3 * (i % 7));
  expect_same(wall, "a sensor beside the window");
  PointScan rays(Pose<Odom, Base>(), Pose<Base, Sensor>::FromTranslation(4, 3, 2));
  for (int i = 0; i < 900; ++i) rays.Add(-3, 3 - 0.008 * i, 0);
  expect_same(rays, "rays across the window");
  EXPECT_GT(pair.cleared(), 0u);
  EXPECT_GT(pair.restarted(), 0u);
  EXPECT_EQ(pair.EvictAll(), "");
  EXPECT_EQ(pair.EvictAll(), "");
}

TEST_F(CudaAgrees, WhereverTheWindowMoves) {
  ShuffleThreads(7);
  LocalMapOptions options = SmallWindow();
  options.side_m = 1.8f;
  Pair pair(options);
  std::uint64_t seq = 1;
  // By columns, by rows, both ways, nearly and altogether out of the window.
  const int kMoves[][2] = {{0, 0},  {1, 0}, {-2, 0}, {0, 3},   {0, -1}, {2, -3},
                           {-8, 8}, {9, 0}, {0, -9}, {-1, -1}, {50, 1}};
  int x = 0, y = 0;
  for (const auto& move : kMoves) {
    x += move[0];
    y += move[1];
    PointScan scan(Pose<Odom, Base>::FromTranslation(0.2 * x + 0.1, 0.2 * y + 0.1, 0), {});
    scan.AddCells({{x - 4, y - 4}, {x + 5, y + 5}}, 0.2,
                  [](double px, double py) { return -1 + 0.05 * px - 0.3 * py; });
    ASSERT_EQ(pair.Fuse(scan.At(seq++)), "") << "moved by " << move[0] << ", " << move[1];
  }
  EXPECT_GT(pair.evicted(), 0u);
}

}  // namespace
}  // namespace gem
