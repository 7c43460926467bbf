// Fig. 13 in a simulation: somebody stands in the way when a place is mapped, and is gone when it
// is mapped again. The global map must forget him, and keep what still stands.
#pragma once

#include <Eigen/Core>
#include <cstdint>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/evaluation/experiment.h"
#include "core/global/map_snapshot.h"

namespace gem::evaluation {

struct PassOptions {
  double way_m = 60;               ///< of each pass
  double gap_s = 400;              ///< from the end of one pass to the beginning of the next
  float merge_overlap_min = 0.5f;  ///< as in GlobalMapOptions; above 1: never merged
  std::uint64_t seed = 1;
};

/// The published map at one time.
struct PassView {
  int pedestrian = 0;  ///< high cells where he stood
  int pillar = 0;      ///< high cells of the pillar across the way, which stays
  std::uint64_t num_submaps = 0;
  std::uint64_t num_points = 0;  ///< cells in all submaps
};

struct TwoPasses {
  PassView first;      ///< after the first pass
  PassView second;     ///< after the second pass, whose odometry is half a metre out
  PassView corrected;  ///< after its correction, and the merging that follows
};

/// Known cells of the map higher than `height_m_min` whose centre is within `reach_m` of the place.
int CountHigh(const MapSnapshot& map, const Eigen::Vector2d& place_m, double reach_m,
              double height_m_min);

/// Drives the two passes. Errors are those of the options.
absl::StatusOr<TwoPasses> DriveTwice(const PassOptions& options);

/// Adds the pedestrian to the report.
absl::Status AddPedestrian(const Settings& settings, Report& report);

}  // namespace gem::evaluation
