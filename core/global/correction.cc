#include "core/global/correction.h"

#include <Eigen/SVD>
#include <algorithm>
#include <cmath>

#include "core/base/check.h"

namespace gem {
namespace {

// To 2^-bits.
double Round(double value, int bits) {
  return std::ldexp(std::nearbyint(std::ldexp(value, bits)), -bits);
}

// A product of two poses that should cancel is off by some 1e-13; rounding brings it back to the
// very same bits. q and -q are one rotation: the one with positive w stands for both.
Pose<Global, Odom> RoundPose(const Pose<Global, Odom>& pose) {
  Eigen::Vector4d q = pose.rotation().coeffs();
  if (pose.rotation().w() < 0) q = -q;
  for (double& coefficient : q) coefficient = Round(coefficient, 40);
  Eigen::Vector3d t = pose.translation();
  for (double& coordinate : t) coordinate = Round(coordinate, 30);
  return {Eigen::Quaterniond(q).normalized(), t};
}

}  // namespace

SessionTrajectory::SessionTrajectory(const Pose<Global, Odom>& T_G_O,
                                     std::size_t odometry_poses_max)
    : initial_T_G_O_(RoundPose(T_G_O)), odometry_poses_max_(odometry_poses_max) {}

SessionTrajectory::SessionTrajectory(const State& state, std::size_t odometry_poses_max)
    : initial_T_G_O_(state.initial_T_G_O), odometry_poses_max_(odometry_poses_max) {
  for (const StampedPose<Odom, Base>& pose : state.odometry)
    odometry_.Append(pose.stamp_ns, pose.T_A_B);
  knots_.reserve(state.corrections.size());
  for (const StampedPose<Global, Odom>& knot : state.corrections)
    knots_.push_back({knot.stamp_ns, knot.T_A_B});
}

SessionTrajectory::State SessionTrajectory::state() const {
  State state{initial_T_G_O_, odometry_.poses(), {}};
  state.corrections.reserve(knots_.size());
  for (const Knot& knot : knots_) state.corrections.push_back({knot.stamp_ns, knot.T_G_O});
  return state;
}

void SessionTrajectory::AppendOdometry(std::int64_t stamp_ns, const Pose<Odom, Base>& T_O_B) {
  // Of a rest only its first and its last pose are kept. Only equal poses are a rest: a correction
  // of any pose in it must find the very pose that SLAM saw.
  const std::vector<StampedPose<Odom, Base>>& poses = odometry_.poses();
  const bool resting = poses.size() >= 2 && Identical(poses.back().T_A_B, T_O_B) &&
                       Identical(poses[poses.size() - 2].T_A_B, T_O_B);
  if (resting) {
    odometry_.MoveBack(stamp_ns);
  } else {
    odometry_.Append(stamp_ns, T_O_B);
  }
  AddReachedKnots();
  if (odometry_.size() > odometry_poses_max_) odometry_.ThinOlderHalf();
}

CorrectionCounts SessionTrajectory::SetCorrection(const CorrectedTrajectory& correction) {
  CorrectionCounts counts;
  std::vector<Knot> knots;
  CorrectedTrajectory ahead;
  for (const StampedPose<Global, Base>& corrected : correction) {
    if (odometry_.empty() || corrected.stamp_ns > odometry_.back().stamp_ns) {
      ahead.push_back(corrected);
    } else if (corrected.stamp_ns < odometry_.front().stamp_ns) {
      ++counts.num_ignored;
    } else {
      knots.push_back(KnotAt(corrected));
    }
  }
  counts.num_used = static_cast<std::uint32_t>(knots.size());
  counts.num_ahead = static_cast<std::uint32_t>(ahead.size());
  if (knots.empty() && ahead.empty()) return counts;

  std::reverse(ahead.begin(), ahead.end());
  ahead_ = std::move(ahead);
  ahead_replaces_ = knots.empty();
  if (!knots.empty()) knots_ = std::move(knots);
  return counts;
}

SessionTrajectory::Knot SessionTrajectory::KnotAt(
    const StampedPose<Global, Base>& corrected) const {
  const Pose<Odom, Base> T_O_B = *odometry_.At(corrected.stamp_ns);
  return {corrected.stamp_ns, RoundPose(corrected.T_A_B * T_O_B.Inverse())};
}

void SessionTrajectory::AddReachedKnots() {
  while (!ahead_.empty() && ahead_.back().stamp_ns <= odometry_.back().stamp_ns) {
    const StampedPose<Global, Base> reached = ahead_.back();
    ahead_.pop_back();
    // Only possible while odometry had not begun when the correction came.
    if (reached.stamp_ns < odometry_.front().stamp_ns) continue;
    if (ahead_replaces_) knots_.clear();
    ahead_replaces_ = false;
    knots_.push_back(KnotAt(reached));
  }
}

Pose<Global, Odom> SessionTrajectory::T_G_O(std::int64_t stamp_ns, const Point<Odom>& about) const {
  if (knots_.empty()) return initial_T_G_O_;
  const auto next = std::lower_bound(knots_.begin(), knots_.end(), stamp_ns,
                                     [](const Knot& k, std::int64_t t) { return k.stamp_ns < t; });
  if (next == knots_.end()) return knots_.back().T_G_O;
  if (next == knots_.begin() || next->stamp_ns == stamp_ns) return next->T_G_O;
  const Knot& before = *(next - 1);
  if (Identical(before.T_G_O, next->T_G_O)) return before.T_G_O;

  const double fraction = static_cast<double>(stamp_ns - before.stamp_ns) /
                          static_cast<double>(next->stamp_ns - before.stamp_ns);
  const Eigen::Quaterniond rotation =
      before.T_G_O.rotation().slerp(fraction, next->T_G_O.rotation()).normalized();
  const Eigen::Vector3d from = (before.T_G_O * about).xyz();
  const Eigen::Vector3d to = (next->T_G_O * about).xyz();
  const Eigen::Vector3d robot_G = from + fraction * (to - from);
  return RoundPose({rotation, robot_G - rotation * about.xyz()});
}

Pose<Global, Odom> SessionTrajectory::T_G_O(std::int64_t stamp_ns) const {
  return T_G_O(stamp_ns, PositionAt(stamp_ns));
}

Pose<Global, Odom> SessionTrajectory::T_G_O(const std::vector<SubmapPart>& parts,
                                            const Pose<Odom, Submap>& T_O_K) const {
  GEM_CHECK(!parts.empty());
  struct Moved {
    Eigen::Vector3d from_m, to_m;  // in O, in G
    Eigen::Matrix3d R_G_O;
  };
  std::vector<Moved> moved;
  moved.reserve(parts.size());
  Eigen::Vector3d from_m = Eigen::Vector3d::Zero();
  Eigen::Vector3d to_m = Eigen::Vector3d::Zero();
  double num_cells = 0;
  const Pose<Global, Odom> first = T_G_O(parts.front().stamp_ns, T_O_K * parts.front().middle);
  bool alike = true;
  for (const SubmapPart& part : parts) {
    const Point<Odom> middle = T_O_K * part.middle;
    const Pose<Global, Odom> C = T_G_O(part.stamp_ns, middle);
    alike = alike && Identical(C, first);
    moved.push_back({middle.xyz(), (C * middle).xyz(), C.matrix()});
    from_m += part.num_cells * moved.back().from_m;
    to_m += part.num_cells * moved.back().to_m;
    num_cells += part.num_cells;
  }
  if (alike) return first;
  from_m /= num_cells;
  to_m /= num_cells;

  // Kabsch. The cells of a part spread about its middle, and its C turns them.
  Eigen::Matrix3d moments = Eigen::Matrix3d::Zero();
  for (std::size_t i = 0; i < parts.size(); ++i)
    moments +=
        parts[i].num_cells * ((moved[i].to_m - to_m) * (moved[i].from_m - from_m).transpose() +
                              parts[i].spread_m2 * moved[i].R_G_O);
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(moments, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Matrix3d R = svd.matrixU() * svd.matrixV().transpose();
  if (R.determinant() < 0) {
    Eigen::Matrix3d U = svd.matrixU();
    U.col(2) = -U.col(2);
    R = U * svd.matrixV().transpose();
  }
  return RoundPose({Eigen::Quaterniond(R).normalized(), to_m - R * from_m});
}

Point<Odom> SessionTrajectory::PositionAt(std::int64_t stamp_ns) const {
  if (odometry_.empty()) return {};
  const std::int64_t within_ns =
      std::clamp(stamp_ns, odometry_.front().stamp_ns, odometry_.back().stamp_ns);
  return Point<Odom>(odometry_.At(within_ns)->translation());
}

}  // namespace gem
