// One function a scene: world, path and drift from checked options. Internal to scenes.cc, where
// the names and the checks are.
#pragma once

#include "absl/status/statusor.h"
#include "client/simulation/scenes.h"
#include "client/simulation/simulated_source.h"

namespace gem {

// Each takes valid options.
Simulation BuildBlock(const SceneOptions& options);
Simulation BuildFlat(const SceneOptions& options);
Simulation BuildCubes(const SceneOptions& options);
Simulation BuildCrowd(const SceneOptions& options);
Simulation BuildSegments(const SceneOptions& options);
/// Errors of the terrain file.
absl::StatusOr<Simulation> BuildTerrain(const SceneOptions& options);

/// What all scenes have in common: the options' LiDAR and seed, and as many steps as the path
/// allows. The world is left empty.
Simulation SimulationOn(Path path, double scan_spacing_m, const SceneOptions& options);

/// Odometry that is some metres out after a block, times `scale`.
DriftRates DriftRatesOf(double scale);

}  // namespace gem
