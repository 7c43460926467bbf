// One sweep of one sensor, as the local mapper takes it: decoded and validated, but untransformed.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <span>

#include "core/geometry/pose.h"
#include "core/sensor/noise_model.h"
#include "core/sensor/packed_points.h"
#include "core/sensor/scan_point.h"

namespace gem {

/// A scan whose points somebody else holds.
struct Scan {
  std::uint64_t seq = 0;
  std::int64_t stamp_ns = 0;
  Pose<Odom, Base> T_O_B;
  Pose<Base, Sensor> T_B_S;
  /// Covariance of the rotation vector of T_O_B, in B, rad^2 (Sigma_phi of eq. (4)). Symmetric,
  /// positive semidefinite.
  Eigen::Matrix3d rotation_covariance_rad2 = Eigen::Matrix3d::Zero();
  /// Covariance of the translation of T_O_B, in O, m^2 (eq. (11)).
  Eigen::Matrix3d translation_covariance_m2 = Eigen::Matrix3d::Zero();
  NoiseModel noise;
  /// One of the two is empty.
  std::span<const ScanPoint> points;
  PackedPoints packed;

  std::size_t num_points() const { return points.size() + packed.count; }
  ScanPoint PointAt(std::size_t index) const {
    return packed.count != 0 ? gem::PointAt(packed, index) : points[index];
  }
};

}  // namespace gem
