#include "client/simulation/drift.h"

#include <cmath>
#include <utility>

namespace gem {
namespace {

bool IsZero(const DriftRates& r) {
  return r.forward_m_per_m == 0 && r.yaw_rad_per_m == 0 && r.height_m_per_m == 0 &&
         r.position_walk_m == 0 && r.yaw_walk_rad == 0 && r.height_walk_m == 0;
}

}  // namespace

Odometry::Odometry(const DriftRates& rates, std::vector<DriftJump> jumps, std::uint64_t seed)
    : rates_(rates), jumps_(std::move(jumps)), random_(seed, /*stream=*/~std::uint64_t{0}) {}

Pose<Odom, Base> Odometry::Advance(double way_m, const Pose<Global, Base>& T_G_B) {
  if (way_m > way_m_ && !IsZero(rates_)) Drift(way_m - way_m_, T_G_B);
  way_m_ = way_m;
  for (; jumps_done_ < jumps_.size() && jumps_[jumps_done_].way_m <= way_m; ++jumps_done_)
    Jump(jumps_[jumps_done_], T_G_B);
  if (!disturbed_) return {T_G_B.rotation(), T_G_B.translation()};
  return T_O_G_ * T_G_B;
}

// The step from the last pose is measured wrongly, in B; the height in O.
void Odometry::Drift(double step_m, const Pose<Global, Base>& T_G_B) {
  const double root_m = std::sqrt(step_m);
  const double forward_m =
      rates_.forward_m_per_m * step_m + rates_.position_walk_m * root_m * random_.Gaussian();
  const double left_m = rates_.position_walk_m * root_m * random_.Gaussian();
  const double yaw_rad =
      rates_.yaw_rad_per_m * step_m + rates_.yaw_walk_rad * root_m * random_.Gaussian();
  const double up_m =
      rates_.height_m_per_m * step_m + rates_.height_walk_m * root_m * random_.Gaussian();
  const auto T_O_B = T_O_G_ * T_G_B * Pose<Base, Base>::FromYaw(yaw_rad, {forward_m, left_m, 0.0});
  T_O_G_ = Pose<Odom, Odom>::FromTranslation(0, 0, up_m) * T_O_B * T_G_B.Inverse();
  disturbed_ = true;
}

void Odometry::Jump(const DriftJump& jump, const Pose<Global, Base>& T_G_B) {
  const Eigen::Vector3d place_m = (T_O_G_ * T_G_B).translation();
  const auto turn = Pose<Odom, Odom>::FromYaw(jump.yaw_rad, Eigen::Vector3d::Zero());
  const Pose<Odom, Odom> T_O_Oold(turn.rotation(),
                                  place_m + jump.shift_m - turn.rotation() * place_m);
  T_O_G_ = T_O_Oold * T_O_G_;
  disturbed_ = true;
}

}  // namespace gem
