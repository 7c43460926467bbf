// How the odometry of a simulated robot errs: it drifts with the way, or it jumps at given places
// and is exact between them.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "client/simulation/random.h"
#include "core/geometry/pose.h"

namespace gem {

/// Errors a metre of way: a systematic part, and a random walk whose sigma grows with the root of
/// the way. All zero: no drift.
struct DriftRates {
  double forward_m_per_m = 0;  ///< the wheel is not as large as believed
  double yaw_rad_per_m = 0;    ///< the gyroscope is biased
  double height_m_per_m = 0;   ///< along z of O
  double position_walk_m = 0;  ///< sigma after one metre, in x and y of B
  double yaw_walk_rad = 0;     ///< sigma after one metre
  double height_walk_m = 0;    ///< sigma after one metre
};

/// At `way_m` the odometry is displaced for good, by a rigid motion in O.
struct DriftJump {
  double way_m = 0;
  Eigen::Vector3d shift_m = Eigen::Vector3d::Zero();
  double yaw_rad = 0;  ///< about the robot's place at the jump
};

/// Turns true poses, given in time order, into odometry. The first is taken as it is.
class Odometry {
 public:
  /// Jumps in the order of their way.
  Odometry(const DriftRates& rates, std::vector<DriftJump> jumps, std::uint64_t seed);

  /// The true pose after `way_m` of path, which never shrinks.
  Pose<Odom, Base> Advance(double way_m, const Pose<Global, Base>& T_G_B);

 private:
  void Drift(double step_m, const Pose<Global, Base>& T_G_B);
  void Jump(const DriftJump& jump, const Pose<Global, Base>& T_G_B);

  // Constant after construction.
  const DriftRates rates_;
  const std::vector<DriftJump> jumps_;

  Random random_;
  std::size_t jumps_done_ = 0;
  double way_m_ = 0;
  bool disturbed_ = false;  ///< false: odometry is the truth, to the bit
  Pose<Odom, Global> T_O_G_;
};

}  // namespace gem
