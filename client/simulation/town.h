// A town grown along a way that a robot drove: ground that fits the way's heights, kerbs, parked
// cars, trees, walls and houses beside it and never on it. For scanning along a recorded trajectory
// whose surroundings nobody kept. The same way and seed give the same town.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <vector>

#include "client/simulation/world.h"

namespace gem {

struct TownOptions {
  /// The ground is known this far from the way, metres; beyond it rays meet nothing.
  double reach_m = 40;
  /// Edge of the ground's raster, metres.
  double ground_cell_m = 1.0;
  /// The ground's height is averaged over about this much of the way, metres: bumps of the
  /// recording are not the street's, and of two passes at two heights the street has the mean.
  double smoothing_m = 3.0;
  std::uint64_t seed = 1;
};

/// way_m: places on the ground in G, in the order driven, at most a few metres apart; at least two
/// different ones. Where the way comes back, its street is furnished once.
std::unique_ptr<World> BuildTown(const std::vector<Eigen::Vector3d>& way_m,
                                 const TownOptions& options);

}  // namespace gem
