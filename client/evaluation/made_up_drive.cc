#include "client/evaluation/made_up_drive.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace gem::evaluation {
namespace {

constexpr double kLaneLength_m = 400;

}  // namespace

Pose<Odom, Base> MadeUpPoseAt(double way_m, double lane_gap_m) {
  const double period_m = kLaneLength_m + lane_gap_m;
  const double lane = std::floor(way_m / period_m);
  const double along_m = std::min(way_m - lane * period_m, kLaneLength_m);
  const double across_m = std::max(way_m - lane * period_m - kLaneLength_m, 0.0);
  const bool back = std::fmod(lane, 2.0) == 1.0;
  return Pose<Odom, Base>::FromYaw(
      back ? std::numbers::pi : 0.0,
      {back ? kLaneLength_m - along_m : along_m, lane * lane_gap_m + across_m, 0.0});
}

float MadeUpGroundAt(CellIndex cell) {
  return 0.3f * std::sin(0.05f * static_cast<float>(cell.x)) +
         0.2f * std::cos(0.03f * static_cast<float>(cell.y));
}

std::vector<StampedPose<Global, Base>> BendDrive(
    const std::vector<StampedPose<Odom, Base>>& odometry, double begin, int number) {
  const auto first = static_cast<std::size_t>(begin * static_cast<double>(odometry.size()));
  std::vector<StampedPose<Global, Base>> corrected;
  const auto add = [&](std::size_t i) {
    const double turned = i < first ? 0.0 : static_cast<double>(i - first);
    const double yaw_rad = turned * 1e-6 * (1 + number % 7);
    const auto T_G_O = Pose<Global, Odom>::FromYaw(yaw_rad, {0, 0, turned * 1e-4 * (number % 5)});
    corrected.push_back({odometry[i].stamp_ns, T_G_O * odometry[i].T_A_B});
  };
  for (std::size_t i = 0; i < odometry.size(); i += 10) add(i);
  if (odometry.size() % 10 != 1) add(odometry.size() - 1);
  return corrected;
}

}  // namespace gem::evaluation
