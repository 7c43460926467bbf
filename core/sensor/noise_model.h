// How a sensor errs: the covariance Sigma_r of one measured point (GEM eq. (4)), for every kind of
// sensor in one form that the CPU and the CUDA mapper share. Makers per sensor kind turn data-sheet
// figures into it.
#pragma once

#include "absl/status/statusor.h"
#include "core/base/host_device.h"

namespace gem {

/// LiDAR (along_beam): Sigma_r = lateral^2 (I - d d^T) + axial^2 d d^T with d the beam's direction;
/// the sigmas are polynomials of u, the range.
/// Cameras: a point is z (x/z, y/z, 1), so an error of the depth z moves it along its ray and one
/// of the pixel moves it parallel to the image: Sigma_r = lateral^2 (I - c c^T) + axial^2 r r^T /
/// z^2 with r the point and c the optical axis z of S; the sigmas are polynomials of u, the depth.
struct NoiseModel {
  bool along_beam = true;        ///< true: u = range (LiDAR); false: u = z_S (cameras)
  float axial_m[3] = {0, 0, 0};  ///< sigma_axial(u) = a0 + a1 u + a2 u^2
  float lateral_m[2] = {0, 0};   ///< sigma_lateral(u) = l0 + l1 u
};

/// Defaults: Pomerleau et al. 2012, the values that the original GEM uses.
struct LidarNoise {
  float sigma_axial_m = 0.018f;
  float sigma_lateral_m = 0.0015f;
  float sigma_lateral_per_m = 0.0006f;
};
struct StereoNoise {
  float focal_length_px = 0;  ///< required, positive
  float baseline_m = 0;       ///< required, positive
  float sigma_disparity_px = 0.5f;
  float sigma_pixel_px = 0.5f;
};
/// sigma_z = a + b (z - c)^2.
struct DepthCameraNoise {
  float a_m = 0.0012f;
  float b_per_m = 0.0019f;
  float c_m = 0.4f;
  float lateral_per_m = 0.002f;
};

/// INVALID_ARGUMENT names the field, its value and the limit.
absl::StatusOr<NoiseModel> MakeNoiseModel(const LidarNoise& noise);
absl::StatusOr<NoiseModel> MakeNoiseModel(const StereoNoise& noise);
absl::StatusOr<NoiseModel> MakeNoiseModel(const DepthCameraNoise& noise);

/// Variance that Sigma_r leaves on direction a: a^T Sigma_r a. a is a unit vector and r the point,
/// both in S, metres.
GEM_HOST_DEVICE inline float VarianceAlong(const NoiseModel& noise, float ax, float ay, float az,
                                           float rx, float ry, float rz, float range_m) {
  const float u = noise.along_beam ? range_m : rz;
  const float axial = noise.axial_m[0] + u * (noise.axial_m[1] + u * noise.axial_m[2]);
  const float lateral = noise.lateral_m[0] + u * noise.lateral_m[1];
  // A beam of zero length has no direction, and nothing is seen at depth zero: then the error is
  // taken as lateral in all directions.
  const float along = u > 0 ? (ax * rx + ay * ry + az * rz) / u : 0.0f;
  const float across2 = 1.0f - (noise.along_beam ? along * along : az * az);
  return lateral * lateral * (u > 0 ? across2 : 1.0f) + axial * axial * (along * along);
}

}  // namespace gem
