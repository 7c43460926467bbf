// Is the map as sure as it is right? Elevation errors against the simulator's truth, divided by
// what the map says of itself.
#pragma once

#include <cstdint>

#include "absl/status/statusor.h"
#include "client/evaluation/experiment.h"
#include "client/simulation/world.h"
#include "core/geometry/pose.h"
#include "core/local/local_map.h"

namespace gem::evaluation {

/// (elevation - truth)^2 / variance over cells. 1 on average: the map knows how wrong it is.
struct NormalisedErrors {
  std::uint64_t num_cells = 0;
  std::uint64_t num_within_2_sigma = 0;
  double sum = 0;            ///< of normalised squares
  double sum_error2_m2 = 0;  ///< of squared errors
  double sum_variance_m2 = 0;

  void Add(double error_m, double variance_m2);
  double mean() const { return num_cells > 0 ? sum / static_cast<double>(num_cells) : 0; }
};

/// Every known cell of the map against the ground under its middle. T_G_O: where the robot's
/// odometry frame truly lies now.
void AddErrors(const LocalMap& map, const World& world, const Pose<Global, Odom>& T_G_O,
               NormalisedErrors& errors);

absl::StatusOr<Report> RunCalibration(const Settings& settings);

}  // namespace gem::evaluation
