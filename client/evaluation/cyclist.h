// Fig. 10 on a recording: a cyclist rides past, and the local map must forget where he was.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "absl/status/status.h"
#include "client/evaluation/experiment.h"
#include "core/local/local_map.h"

namespace gem::evaluation {

/// The ground that something moving swept, in O.
struct SweptPath {
  std::vector<Eigen::Vector2d> track_m;  ///< at least two places, joined by straight lines
  double half_width_m = 0.5;
  /// Cells above this are neither ground nor kerb.
  double elevation_m_min = 0.35;
  /// A thing that stands beside the track, and how far about it cells belong to it.
  Eigen::Vector2d standing_m = Eigen::Vector2d::Zero();
  double standing_reach_m = 0.5;

  bool Covers(const Eigen::Vector2d& place_m) const;
};

/// Known cells whose centre is on the swept path.
struct SweptCells {
  int known = 0;
  int obstacles = 0;  ///< not free: things, and kerbs beside them
  int trail = 0;      ///< of them, higher than any ground; without the thing that stands
  int standing = 0;   ///< of them, of the thing that stands
};
SweptCells CountSwept(const LocalMap& map, const SweptPath& path);

/// Adds the cyclist of kitti_raw_0001 to the report, or says why not.
absl::Status AddCyclist(const Settings& settings, Report& report);

}  // namespace gem::evaluation
