// A drive that is made up for benchmarks: a way that winds to and fro, the ground under it, and
// corrections that bend it. No sensor and no noise: what is measured must not depend on either.
#pragma once

#include <cstdint>
#include <vector>

#include "core/geometry/trajectory.h"
#include "core/grid/cell_belief.h"

namespace gem::evaluation {

/// From one pose of the drive to the next.
inline constexpr double kMadeUpStep_m = 1.0;
inline constexpr std::int64_t kMadeUpStep_ns = 100'000'000;

/// After so much way, up one lane and down the next. A lane gap of twice the width of what is
/// mapped keeps submaps of neighbouring lanes apart, so that none is merged.
Pose<Odom, Base> MadeUpPoseAt(double way_m, double lane_gap_m);

/// Of the ground in O, metres; smooth, and a little different in every cell.
float MadeUpGroundAt(CellIndex cell);

/// Corrected poses that bend everything after `begin` of the drive, [0, 1), a little differently
/// for each number. As sparse as the poses of a SLAM system: every tenth, and the last.
std::vector<StampedPose<Global, Base>> BendDrive(
    const std::vector<StampedPose<Odom, Base>>& odometry, double begin, int number);

}  // namespace gem::evaluation
