// The ground of a town: one height over every place near a way, from the heights along it.
#pragma once

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "client/simulation/grid_terrain.h"
#include "client/simulation/town.h"

namespace gem {

/// Heights are means of the way's, weighted by nearness; unknown farther than options.reach_m from
/// the way.
std::unique_ptr<const GridTerrain> GroundAlong(const std::vector<Eigen::Vector3d>& way_m,
                                               const TownOptions& options);

}  // namespace gem
