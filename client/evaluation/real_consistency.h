// The part of the consistency experiment that needs no simulator: real scans with real odometry and
// corrected poses. They pass no street twice, so the deformed map is held against the map that is
// built from the corrected poses.
#pragma once

#include <filesystem>

#include "absl/status/status.h"
#include "client/evaluation/experiment.h"

namespace gem::evaluation {

/// Adds its figures and its table. dir: kitti_00_keyframes.
absl::Status AddRealConsistency(const std::filesystem::path& dir, const Settings& settings,
                                Report& report);

}  // namespace gem::evaluation
