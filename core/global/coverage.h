// Which cells, tiles and groups of one frame lie under boxes of another: what a move touches.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstdint>
#include <vector>

#include "core/global/submap.h"
#include "core/grid/cell_index.h"

namespace gem {

/// Cells of a frame F between two heights over z = 0 of F.
struct CellBox {
  CellRect rect;
  float elevation_m_min = 0;
  float elevation_m_max = 0;
};

/// Smallest rectangle of cells of A whose centres may lie over the box; empty for places beyond
/// any valid coordinate.
CellRect RectUnder(const CellBox& box, const Eigen::Matrix3d& R_A_F, const Eigen::Vector3d& t_A_F,
                   double cell_size_m);

/// What a group of the submap may show in a tile, the sides of its steps included.
CellBox BoxOf(const Submap& submap, const Submap::Group& group);

/// How many squares of 2^bits cells the rectangle touches.
inline std::uint64_t NumSquares(const CellRect& rect, int bits) {
  if (rect.empty()) return 0;
  const auto along = [bits](std::int32_t min, std::int32_t max) {
    return static_cast<std::uint64_t>(((max - 1) >> bits) - (min >> bits)) + 1;
  };
  return along(rect.min.x, rect.max.x) * along(rect.min.y, rect.max.y);
}

/// Appends the indices of the squares of 2^bits cells that the rectangle touches. Square:
/// TileIndex, or CellIndex for groups.
template <typename Square>
void AppendSquares(const CellRect& rect, int bits, std::vector<Square>& squares) {
  if (rect.empty()) return;
  for (std::int32_t y = rect.min.y >> bits; y <= (rect.max.y - 1) >> bits; ++y)
    for (std::int32_t x = rect.min.x >> bits; x <= (rect.max.x - 1) >> bits; ++x)
      squares.push_back(Square{x, y});
}

/// Sorts and removes repeats.
template <typename Square>
void SortUnique(std::vector<Square>& squares) {
  std::sort(squares.begin(), squares.end());
  squares.erase(std::unique(squares.begin(), squares.end()), squares.end());
}

/// True if the group of `submap` holds the same cells with the same values in `other`.
bool SameGroup(const Submap& submap, const Submap::Group& group, const Submap& other);

}  // namespace gem
