// Places and rectangles of G in metres, and the tiles that they touch.
#pragma once

#include <cmath>

#include "core/grid/cell_index.h"

namespace gem {

/// A place in the x-y plane of G.
struct Place {
  double x_m = 0;
  double y_m = 0;
  friend bool operator==(const Place&, const Place&) = default;
};

/// A rectangle of G, half open: [x_m_min, x_m_max) x [y_m_min, y_m_max). Not empty.
struct Region {
  double x_m_min = 0;
  double y_m_min = 0;
  double x_m_max = 0;
  double y_m_max = 0;

  Place middle() const { return {(x_m_min + x_m_max) / 2, (y_m_min + y_m_max) / 2}; }
  friend bool operator==(const Region&, const Region&) = default;
};

/// Edge of a tile of a level, metres. cell_size_m: at level 0.
inline double TileSideAt(int level, double cell_size_m) {
  return CellSizeAt(level, cell_size_m) * kTileCells;
}

/// The tiles of a level that share area with a region, whose coordinates are at most 2 *
/// kCoordinateMax_m in magnitude.
inline TileRange TilesTouching(const Region& region, int level, double cell_size_m) {
  const double side_m = TileSideAt(level, cell_size_m);
  const auto down = [side_m](double m) {
    return static_cast<std::int32_t>(std::floor(m / side_m));
  };
  const auto up = [side_m](double m) { return static_cast<std::int32_t>(std::ceil(m / side_m)); };
  return {{down(region.x_m_min), down(region.y_m_min)}, {up(region.x_m_max), up(region.y_m_max)}};
}

}  // namespace gem
