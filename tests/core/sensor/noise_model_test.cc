#include "core/sensor/noise_model.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace gem {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

TEST(LidarNoise, IsAxialAlongTheBeamAndLateralAcross) {
  const NoiseModel noise = *MakeNoiseModel(LidarNoise());
  // 10 m along x: axial 0.018 m, lateral 0.0015 + 0.006 = 0.0075 m.
  EXPECT_FLOAT_EQ(VarianceAlong(noise, 1, 0, 0, 10, 0, 0, 10), 0.018f * 0.018f);
  EXPECT_FLOAT_EQ(VarianceAlong(noise, 0, 0, 1, 10, 0, 0, 10), 0.0075f * 0.0075f);
  // At 45 degrees, half of each.
  const float s = std::sqrt(0.5f);
  EXPECT_NEAR(VarianceAlong(noise, s, 0, s, 10, 0, 0, 10), (0.018 * 0.018 + 0.0075 * 0.0075) / 2,
              1e-9);
}

TEST(LidarNoise, OfABeamWithoutLengthIsLateral) {
  const NoiseModel noise = *MakeNoiseModel(LidarNoise());
  EXPECT_FLOAT_EQ(VarianceAlong(noise, 1, 0, 0, 0, 0, 0, 0), 0.0015f * 0.0015f);
}

TEST(StereoNoise, GrowsWithTheSquareOfTheDepth) {
  const NoiseModel noise = *MakeNoiseModel(StereoNoise{.focal_length_px = 500, .baseline_m = 0.1f});
  // z^2 / (f B) * sigma_d: at 5 m 25 / 50 * 0.5 = 0.25 m, at 10 m four times that.
  EXPECT_FLOAT_EQ(VarianceAlong(noise, 0, 0, 1, 0, 0, 5, 5), 0.0625f);
  EXPECT_FLOAT_EQ(VarianceAlong(noise, 0, 0, 1, 0, 0, 10, 10), 1.0f);
  // Across, half a pixel: 5 m * 0.5 / 500 = 0.005 m. The depth counts, not the range.
  EXPECT_FLOAT_EQ(VarianceAlong(noise, 1, 0, 0, 0, 3, 5, 5.83f), 2.5e-5f);
}

// An error of the depth moves a point along its ray, so ground that a level camera looks down on
// errs in height: 10 m ahead and 2 m below, sigma_z = 1 m is 0.2 m of height.
TEST(StereoNoise, OfADepthMovesThePointAlongItsRay) {
  const NoiseModel noise = *MakeNoiseModel(StereoNoise{.focal_length_px = 500, .baseline_m = 0.1f});
  EXPECT_NEAR(VarianceAlong(noise, 0, 1, 0, 0, 2, 10, 10.2f), 0.2 * 0.2 + 0.01 * 0.01, 1e-7);
}

TEST(DepthCameraNoise, IsAParabolaAboutItsBestDepth) {
  const NoiseModel noise = *MakeNoiseModel(DepthCameraNoise());
  // a + b (z - c)^2: 0.0012 m at 0.4 m, 0.0012 + 0.0019 * 2.56 = 0.006064 m at 2 m.
  EXPECT_NEAR(VarianceAlong(noise, 0, 0, 1, 0, 0, 0.4f, 0.4f), 0.0012 * 0.0012, 1e-10);
  EXPECT_NEAR(VarianceAlong(noise, 0, 0, 1, 0, 0, 2, 2), 0.006064 * 0.006064, 1e-9);
  EXPECT_NEAR(VarianceAlong(noise, 0, 1, 0, 0, 0, 2, 2), 0.004 * 0.004, 1e-9);
}

TEST(MakeNoiseModel, NamesFieldValueAndLimit) {
  EXPECT_EQ(MakeNoiseModel(LidarNoise{.sigma_axial_m = 0}).status().message(),
            "lidar.sigma_axial_m is 0, want a finite number above 0");
  EXPECT_EQ(MakeNoiseModel(LidarNoise{.sigma_lateral_per_m = -1}).status().message(),
            "lidar.sigma_lateral_per_m is -1, want a finite number of at least 0");
  EXPECT_EQ(MakeNoiseModel(StereoNoise{.baseline_m = 1}).status().message(),
            "stereo.focal_length_px is 0, want a finite number above 0");
  EXPECT_EQ(MakeNoiseModel(DepthCameraNoise{.a_m = -2}).status().message(),
            "depth_camera.a_m is -2, want a finite number above 0");
}

TEST(MakeNoiseModel, RefusesNanAndInfinity) {
  EXPECT_FALSE(MakeNoiseModel(LidarNoise{.sigma_axial_m = kNan}).ok());
  EXPECT_FALSE(MakeNoiseModel(LidarNoise{.sigma_lateral_m = kNan}).ok());
  EXPECT_FALSE(MakeNoiseModel(StereoNoise{.focal_length_px = 1e30f * 1e30f, .baseline_m = 1}).ok());
  EXPECT_FALSE(MakeNoiseModel(DepthCameraNoise{.c_m = kNan}).ok());
}

}  // namespace
}  // namespace gem
