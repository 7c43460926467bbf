// A rectified stereo pair whose matcher errs in disparity and in the pixel, and in nothing else:
// the points that it would give, in the camera's axes (x right, y down, z forward).
#pragma once

#include <cstdint>
#include <vector>

#include "client/simulation/world.h"
#include "core/geometry/pose.h"
#include "core/sensor/noise_model.h"
#include "core/sensor/scan.h"

namespace gem {

struct StereoCameraOptions {
  int width_px = 1241;
  int height_px = 376;
  /// Every so many pixels of a row and of a column are matched.
  int step_px = 6;
  /// Nothing deeper is matched, metres.
  double depth_m_max = 20;
  /// Focal length, baseline and how the matcher errs. Default: KITTI's.
  StereoNoise noise = {.focal_length_px = 718.0f, .baseline_m = 0.54f};
};

/// Immutable, so any number of threads may look.
class StereoCamera {
 public:
  /// The caller has checked the options: positive sizes, focal length and baseline.
  explicit StereoCamera(const StereoCameraOptions& options) : options_(options) {}

  const StereoCameraOptions& options() const { return options_; }

  /// Points in S, by rows of the image. `scan` and `seed` choose the noise.
  void Scan(const World& world, const Pose<Global, Sensor>& T_G_S, double time_s,
            std::uint64_t seed, std::uint64_t scan, std::vector<ScanPoint>& points) const;

 private:
  // Constant after construction.
  StereoCameraOptions options_;
};

}  // namespace gem
