#include "client/simulation/stereo_camera.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>

#include "client/simulation/analytic_terrain.h"

namespace gem {
namespace {

// A wall 10 m ahead of a camera that looks along x of G.
class StereoCameraTest : public ::testing::Test {
 protected:
  StereoCameraTest()
      : world_(std::make_unique<AnalyticTerrain>(GroundPlane{.height_m = -100}, std::vector<Hill>(),
                                                 std::vector<Step>())) {
    Box wall;
    wall.center_m = {10.5, 0};
    wall.size_m = {1, 100};
    wall.z_m_min = -50;
    wall.z_m_max = 50;
    world_.Add(wall);
    Eigen::Matrix3d R;
    R << 0, 0, 1, -1, 0, 0, 0, -1, 0;
    T_G_S_ = {Eigen::Quaterniond(R), {0, 0, 0}};
  }

  std::vector<ScanPoint> Look(const StereoCameraOptions& options) const {
    std::vector<ScanPoint> points;
    StereoCamera(options).Scan(world_, T_G_S_, 0, 1, 0, points);
    return points;
  }

  World world_;
  Pose<Global, Sensor> T_G_S_;
};

TEST_F(StereoCameraTest, WithoutNoiseSeesTheWallAtItsDepth) {
  StereoCameraOptions options;
  options.noise.sigma_disparity_px = 0;
  options.noise.sigma_pixel_px = 0;
  const std::vector<ScanPoint> points = Look(options);
  EXPECT_EQ(points.size(), 207u * 63u);  // every sixth pixel of 1241 x 376
  for (const ScanPoint& point : points) EXPECT_NEAR(point.z_m, 10, 1e-4);
}

TEST_F(StereoCameraTest, ErrsAsItsNoiseModelSays) {
  StereoCameraOptions options;
  const std::vector<ScanPoint> points = Look(options);
  double sum_m2 = 0;
  for (const ScanPoint& point : points) sum_m2 += std::pow(point.z_m - 10, 2);
  // sigma_z = z^2 / (f B) * sigma_d = 100 / (718 * 0.54) * 0.5 = 0.129 m.
  EXPECT_NEAR(std::sqrt(sum_m2 / static_cast<double>(points.size())), 0.129, 0.004);
}

TEST_F(StereoCameraTest, MatchesNothingBeyondItsDepth) {
  StereoCameraOptions options;
  options.noise.sigma_disparity_px = 0.01f;
  options.depth_m_max = 9.5;
  EXPECT_TRUE(Look(options).empty());
}

}  // namespace
}  // namespace gem
