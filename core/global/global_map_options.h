// Options of the global dense mapper (paper section V), with unit, default, range and reason.
#pragma once

#include "absl/status/status.h"

namespace gem {

struct GlobalMapOptions {
  /// Edge of a cell; every session of the map shares it. Range [0.01, 10].
  float cell_size_m = 0.2f;
  /// A new submap starts after this much path: a shorter one follows a correction more closely,
  /// a longer one costs less. At 10 m two passes over KITTI 00 lie 1.5 times as far apart as with
  /// poses that were right from the start; at 20 m, the paper's, 1.6 times. Range [0.1, 10000]; one
  /// that would grow longer than kSubmapSideCells_max cells ends there.
  float submap_length_m = 10.0f;
  /// True: keep traversable cells only, as the paper does; then an obstacle is not told from the
  /// unknown.
  bool traversable_only = false;
  /// Cells above this are free. Range (0, 1).
  float traversability_free = 0.7f;

  // Composing.
  /// Two submaps that differ by more than so many standard deviations disagree: the newer
  /// observation wins. Range (0, 100].
  float gate_sigmas = 3.0f;
  /// Threads that render tiles. Range [1, 64].
  int compose_threads = 2;

  // Maintenance.
  /// A finished submap is merged into its nearest neighbour if so much of it overlaps. Range (0,
  /// 1]; up to 1000 is taken and means never.
  float merge_overlap_min = 0.5f;
  /// Within this time cells are fused, beyond it the newer one wins, seconds. Range [0, 1e9].
  double merge_fuse_time_s_max = 300.0;
  /// Overlapping floors whose median heights differ by more than this are not the same floor, or
  /// not corrected yet: they are not merged. Range (0, 1000]. Not in the paper.
  float merge_height_difference_m_max = 0.3f;

  // Limits.
  /// Poses of odometry kept per session; beyond it the oldest are thinned out. Range [2, 1e8].
  int odometry_poses_max = 1'000'000;
};

/// INVALID_ARGUMENT: "map.cell_size_m is -1, want [0.01, 10]".
absl::Status Validate(const GlobalMapOptions& options);

}  // namespace gem
