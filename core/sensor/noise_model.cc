#include "core/sensor/noise_model.h"

#include <cmath>

#include "absl/strings/str_cat.h"
#include "core/base/status_macros.h"

namespace gem {
namespace {

absl::Status Positive(const char* field, float value) {
  if (std::isfinite(value) && value > 0) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrCat(field, " is ", value, ", want a finite number above 0"));
}

absl::Status NotNegative(const char* field, float value) {
  if (std::isfinite(value) && value >= 0) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrCat(field, " is ", value, ", want a finite number of at least 0"));
}

}  // namespace

absl::StatusOr<NoiseModel> MakeNoiseModel(const LidarNoise& noise) {
  GEM_RETURN_IF_ERROR(Positive("lidar.sigma_axial_m", noise.sigma_axial_m));
  GEM_RETURN_IF_ERROR(NotNegative("lidar.sigma_lateral_m", noise.sigma_lateral_m));
  GEM_RETURN_IF_ERROR(NotNegative("lidar.sigma_lateral_per_m", noise.sigma_lateral_per_m));
  return NoiseModel{.along_beam = true,
                    .axial_m = {noise.sigma_axial_m, 0, 0},
                    .lateral_m = {noise.sigma_lateral_m, noise.sigma_lateral_per_m}};
}

absl::StatusOr<NoiseModel> MakeNoiseModel(const StereoNoise& noise) {
  GEM_RETURN_IF_ERROR(Positive("stereo.focal_length_px", noise.focal_length_px));
  GEM_RETURN_IF_ERROR(Positive("stereo.baseline_m", noise.baseline_m));
  GEM_RETURN_IF_ERROR(Positive("stereo.sigma_disparity_px", noise.sigma_disparity_px));
  GEM_RETURN_IF_ERROR(NotNegative("stereo.sigma_pixel_px", noise.sigma_pixel_px));
  // z = f B / d, so sigma_z = z^2 / (f B) * sigma_d.
  const float per_m = noise.sigma_disparity_px / (noise.focal_length_px * noise.baseline_m);
  return NoiseModel{.along_beam = false,
                    .axial_m = {0, 0, per_m},
                    .lateral_m = {0, noise.sigma_pixel_px / noise.focal_length_px}};
}

absl::StatusOr<NoiseModel> MakeNoiseModel(const DepthCameraNoise& noise) {
  GEM_RETURN_IF_ERROR(Positive("depth_camera.a_m", noise.a_m));
  GEM_RETURN_IF_ERROR(NotNegative("depth_camera.b_per_m", noise.b_per_m));
  GEM_RETURN_IF_ERROR(NotNegative("depth_camera.c_m", noise.c_m));
  GEM_RETURN_IF_ERROR(NotNegative("depth_camera.lateral_per_m", noise.lateral_per_m));
  const float a = noise.a_m, b = noise.b_per_m, c = noise.c_m;
  return NoiseModel{.along_beam = false,
                    .axial_m = {a + b * c * c, -2 * b * c, b},
                    .lateral_m = {0, noise.lateral_per_m}};
}

}  // namespace gem
