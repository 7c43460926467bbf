// Finds cubes in a local map without being told where they are: the picking that the authors of the
// paper did by hand (Table I). Knows the map alone.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "core/local/local_map.h"

namespace gem::evaluation {

struct PickedCube {
  /// Middle of the high cells' centres, in O.
  Eigen::Vector2d place_m = Eigen::Vector2d::Zero();
  /// Of the top over the ground around it. The top is the upper quartile of the high cells: cells
  /// at the cube's edge hold points of its sides, too, and lie a centimetre or two lower.
  double height_m = 0;
  /// The same, of the median of the high cells.
  double median_height_m = 0;
  std::vector<CellIndex> cells = {};
};

/// Every group of neighbouring cells more than `height_m_min` over the ground, by row and column of
/// its first cell. Most of the map is ground.
std::vector<PickedCube> PickCubes(const LocalMap& map, double height_m_min = 0.25);

}  // namespace gem::evaluation
