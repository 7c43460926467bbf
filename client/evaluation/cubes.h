// Table I: how truly the local map shows the height of cubes and the distances between them.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "absl/status/statusor.h"
#include "client/evaluation/cube_picker.h"
#include "client/evaluation/experiment.h"
#include "client/simulation/simulated_source.h"

namespace gem::evaluation {

/// How the picked cubes of one map differ from the true ones.
struct CubeErrors {
  int found = 0;  ///< true cubes with a picked one within half a metre
  int false_picks = 0;
  /// Mean of |height - true height| of the cubes found; NaN if none is.
  double height_m = 0;
  double median_height_m = 0;  ///< the same, of the median of the high cells
  /// Mean of |distance - true distance| of all pairs of cubes found; NaN if there is no pair.
  double distance_m = 0;
};

CubeErrors CompareCubes(const std::vector<PickedCube>& picked, std::span<const Box> truth);

/// Six cubes at random places and angles about a sensor that passes slowly, poses true. Same seed,
/// same scene.
absl::StatusOr<std::unique_ptr<SimulatedSource>> MakeRandomCubes(std::uint64_t seed);

/// The local maps, one a cell size, after all scans of the source.
absl::StatusOr<std::vector<LocalMap>> MapAtSizes(SimulatedSource& source,
                                                 std::span<const double> cell_sizes_m);

absl::StatusOr<Report> RunCubes(const Settings& settings);

}  // namespace gem::evaluation
