#include "core/global/coverage.h"

#include <algorithm>
#include <cmath>

namespace gem {
namespace {

// Far beyond kCoordinateMax_m at the smallest cell, yet sums of two still fit an integer.
constexpr double kCellFar = 1 << 30;

}  // namespace

CellRect RectUnder(const CellBox& box, const Eigen::Matrix3d& R_A_F, const Eigen::Vector3d& t_A_F,
                   double cell_size_m) {
  const Eigen::Vector3d min(box.rect.min.x * cell_size_m, box.rect.min.y * cell_size_m,
                            box.elevation_m_min);
  const Eigen::Vector3d max(box.rect.max.x * cell_size_m, box.rect.max.y * cell_size_m,
                            box.elevation_m_max);
  const Eigen::Vector3d center = R_A_F * (0.5 * (min + max)) + t_A_F;
  const Eigen::Vector3d half = R_A_F.cwiseAbs() * (0.5 * (max - min));
  // A little slack for rounding; far less than half a cell.
  constexpr double kSlack_cells = 1e-6;
  const auto first = [&](double low_m) {
    return std::ceil(low_m / cell_size_m - 0.5 - kSlack_cells);
  };
  const auto last = [&](double high_m) {
    return std::floor(high_m / cell_size_m - 0.5 + kSlack_cells);
  };
  const double x0 = first(center.x() - half.x()), x1 = last(center.x() + half.x()) + 1;
  const double y0 = first(center.y() - half.y()), y1 = last(center.y() + half.y()) + 1;
  if (!(x0 > -kCellFar && y0 > -kCellFar && x1 < kCellFar && y1 < kCellFar)) return {};
  return {{static_cast<std::int32_t>(x0), static_cast<std::int32_t>(y0)},
          {static_cast<std::int32_t>(x1), static_cast<std::int32_t>(y1)}};
}

CellBox BoxOf(const Submap& submap, const Submap::Group& group) {
  const CellRect& rect = submap.rect();
  return {{{std::max(group.origin.x, rect.min.x), std::max(group.origin.y, rect.min.y)},
           {std::min(group.origin.x + kGroupCells, rect.max.x),
            std::min(group.origin.y + kGroupCells, rect.max.y)}},
          submap.elevation_m_min(),
          group.elevation_m_max};
}

bool SameGroup(const Submap& submap, const Submap::Group& group, const Submap& other) {
  const Submap::Group* there = other.FindGroup(group.origin);
  if (there == nullptr || there->occupied != group.occupied) return false;
  for (std::size_t i = 0; i < group.num_cells(); ++i)
    if (!(submap.At(group.first + i) == other.At(there->first + i))) return false;
  return true;
}

}  // namespace gem
