// SLAM's corrected trajectory of one session and where it puts what hangs on the odometry (paper
// section V-B).
#pragma once

#include <cstdint>
#include <vector>

#include "core/geometry/pose.h"
#include "core/geometry/trajectory.h"
#include "core/global/submap_part.h"

namespace gem {

/// Strictly increasing stamps, at least one, finite poses.
using CorrectedTrajectory = std::vector<StampedPose<Global, Base>>;

/// How the poses of a correction relate to the session.
struct CorrectionCounts {
  std::uint32_t num_used = 0;
  std::uint32_t num_ahead = 0;    ///< stamps after the newest odometry: kept until it gets there
  std::uint32_t num_ignored = 0;  ///< stamps before the first odometry
};

/// The odometry of one session with its newest correction. Answers T_G_O at any stamp.
///
/// C(t) = T_G_B(t) * T_O_B(t)^-1 is known at the stamps of the correction and is interpolated
/// between them about the robot's position, so that a small change of rotation far from the origin
/// of O does no harm. Outside the list's range the nearest C is applied rigidly. C is rounded to
/// 2^-30 m and 2^-40, so that a correction that repeats the first map_from_odom restores the map
/// byte for byte.
class SessionTrajectory {
 public:
  /// odometry_poses_max: at least 2.
  SessionTrajectory(const Pose<Global, Odom>& T_G_O, std::size_t odometry_poses_max);

  /// What it knows, without the poses of a correction that lie ahead of the odometry.
  struct State {
    Pose<Global, Odom> initial_T_G_O;  ///< of the session's opening, rounded
    std::vector<StampedPose<Odom, Base>> odometry;
    std::vector<StampedPose<Global, Odom>> corrections;  ///< C at the correction's stamps
  };
  State state() const;
  /// As it was, bit for bit. Stamps increase strictly.
  SessionTrajectory(const State& state, std::size_t odometry_poses_max);

  /// stamp_ns must be newer than the newest. A robot that stands still costs no memory; at the
  /// limit the older half is thinned out.
  void AppendOdometry(std::int64_t stamp_ns, const Pose<Odom, Base>& T_O_B);

  /// Replaces every earlier correction. If all its stamps lie ahead, the earlier one holds until
  /// the first of them is reached, so that the map does not jump back in between. If all lie before
  /// the session began, nothing changes.
  CorrectionCounts SetCorrection(const CorrectedTrajectory& correction);

  /// C at the stamp; T_G_O of the session's opening before the first correction. about: where the
  /// robot was, the fixed point of the interpolation.
  Pose<Global, Odom> T_G_O(std::int64_t stamp_ns, const Point<Odom>& about) const;

  /// The same about the position that odometry gives for the stamp.
  Pose<Global, Odom> T_G_O(std::int64_t stamp_ns) const;

  /// The one rigid motion that comes nearest to moving each part of a submap by C at its own stamp:
  /// least squares over its cells. Odometry drifts while a submap grows, and a correction knows by
  /// how much. With C at one stamp, the error of that one pose would turn the whole submap. At
  /// least one part.
  Pose<Global, Odom> T_G_O(const std::vector<SubmapPart>& parts,
                           const Pose<Odom, Submap>& T_O_K) const;

  /// Empty before the first odometry.
  const Trajectory<Odom, Base>& odometry() const { return odometry_; }

 private:
  struct Knot {  ///< C at one stamp of the correction
    std::int64_t stamp_ns = 0;
    Pose<Global, Odom> T_G_O;
  };

  Knot KnotAt(const StampedPose<Global, Base>& corrected) const;
  void AddReachedKnots();
  Point<Odom> PositionAt(std::int64_t stamp_ns) const;

  const Pose<Global, Odom> initial_T_G_O_;
  const std::size_t odometry_poses_max_;
  Trajectory<Odom, Base> odometry_;
  std::vector<Knot> knots_;      ///< by stamp
  CorrectedTrajectory ahead_;    ///< by stamp, newest first: the next one is at the back
  bool ahead_replaces_ = false;  ///< the first of ahead_ to be reached replaces knots_
};

}  // namespace gem
