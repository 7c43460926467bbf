#include "client/simulation/grid_terrain.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "core/base/check.h"

namespace gem {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// The part [begin, end] of a ray inside [low, high] along one axis; empty: begin > end.
void Clip(double origin, double direction, double low, double high, double& begin, double& end) {
  if (std::abs(direction) < 1e-12) {
    if (origin < low || origin > high) end = -kInfinity;
    return;
  }
  const double a = (low - origin) / direction;
  const double b = (high - origin) / direction;
  begin = std::max(begin, std::min(a, b));
  end = std::min(end, std::max(a, b));
}

/// Walks along one axis of the grid: the patch the ray is in and where it leaves it.
struct Axis {
  int cell = 0;
  int step = 0;
  double next_m = kInfinity;    ///< range at which the ray enters the next patch
  double period_m = kInfinity;  ///< range from one border to the next

  Axis(double origin, double direction, double begin_m, double low, double spacing, int cells) {
    const double at = (origin + begin_m * direction - low) / spacing;
    cell = std::clamp(static_cast<int>(std::floor(at)), 0, cells - 1);
    if (std::abs(direction) < 1e-12) return;
    step = direction > 0 ? 1 : -1;
    const double border = low + (cell + (step > 0 ? 1 : 0)) * spacing;
    next_m = (border - origin) / direction;
    period_m = spacing / std::abs(direction);
  }
};

}  // namespace

GridTerrain::GridTerrain(EsriAsciiGrid grid) : grid_(std::move(grid)) {
  GEM_CHECK(grid_.columns >= 2 && grid_.rows >= 2 && grid_.cell_size_m > 0);
  const std::size_t num_cells = static_cast<std::size_t>(grid_.columns) * grid_.rows;
  GEM_CHECK(grid_.values.size() == num_cells && grid_.valid.size() == num_cells);
}

std::optional<GridTerrain::Patch> GridTerrain::PatchAt(int column, int row) const {
  const std::size_t low = static_cast<std::size_t>(row) * grid_.columns + column;
  const std::size_t high = low + grid_.columns;
  if (!(grid_.valid[low] && grid_.valid[low + 1] && grid_.valid[high] && grid_.valid[high + 1]))
    return std::nullopt;
  const double z00 = grid_.values[low];
  const double z10 = grid_.values[low + 1];
  const double z01 = grid_.values[high];
  const double z11 = grid_.values[high + 1];
  return Patch{.a = z00,
               .b = z10 - z00,
               .c = z01 - z00,
               .d = z11 - z10 - z01 + z00,
               .z_m_max = std::max({z00, z10, z01, z11})};
}

std::optional<double> GridTerrain::HeightAt(double x_m, double y_m) const {
  const double u = (x_m - x_m_min()) / grid_.cell_size_m;
  const double v = (y_m - y_m_min()) / grid_.cell_size_m;
  if (!(u >= 0 && u <= grid_.columns - 1 && v >= 0 && v <= grid_.rows - 1)) return std::nullopt;
  const int column = std::min(static_cast<int>(u), grid_.columns - 2);
  const int row = std::min(static_cast<int>(v), grid_.rows - 2);
  const std::optional<Patch> patch = PatchAt(column, row);
  if (!patch) return std::nullopt;
  const double fu = u - column;
  const double fv = v - row;
  return patch->a + patch->b * fu + patch->c * fv + patch->d * fu * fv;
}

// First root in [begin_m, end_m] of ray height minus patch height, which is quadratic in the range.
std::optional<double> GridTerrain::CastPatch(const Ray& ray, int column, int row, double begin_m,
                                             double end_m) const {
  const std::optional<Patch> known = PatchAt(column, row);
  if (!known) return std::nullopt;
  const Patch& patch = *known;
  const Eigen::Vector3d enter = ray.At(begin_m);
  const double sinks_to_m = std::min(enter.z(), ray.At(end_m).z());
  if (sinks_to_m > patch.z_m_max) return std::nullopt;
  // Along the ray from `enter`: u = u0 + du t, v = v0 + dv t.
  const double u0 = (enter.x() - x_m_min()) / grid_.cell_size_m - column;
  const double v0 = (enter.y() - y_m_min()) / grid_.cell_size_m - row;
  const double du = ray.direction.x() / grid_.cell_size_m;
  const double dv = ray.direction.y() / grid_.cell_size_m;
  const double c0 = enter.z() - (patch.a + patch.b * u0 + patch.c * v0 + patch.d * u0 * v0);
  const double c1 =
      ray.direction.z() - (patch.b * du + patch.c * dv + patch.d * (u0 * dv + v0 * du));
  const double c2 = -patch.d * du * dv;
  const double length_m = end_m - begin_m;
  if (c0 <= 0) return begin_m;
  if (std::abs(c2) < 1e-15) {
    if (c1 >= 0) return std::nullopt;
    const double root_m = -c0 / c1;
    return root_m <= length_m ? std::optional(begin_m + root_m) : std::nullopt;
  }
  const double discriminant = c1 * c1 - 4 * c2 * c0;
  if (discriminant < 0) return std::nullopt;
  // The form that does not cancel.
  const double q = -0.5 * (c1 + std::copysign(std::sqrt(discriminant), c1));
  double nearest_m = kInfinity;
  for (const double root_m : {q / c2, q != 0 ? c0 / q : kInfinity}) {
    if (root_m >= 0 && root_m <= length_m) nearest_m = std::min(nearest_m, root_m);
  }
  if (nearest_m == kInfinity) return std::nullopt;
  return begin_m + nearest_m;
}

std::optional<double> GridTerrain::Cast(const Ray& ray, double range_m_max) const {
  double begin_m = 0;
  double end_m = range_m_max;
  Clip(ray.origin.x(), ray.direction.x(), x_m_min(), x_m_max(), begin_m, end_m);
  Clip(ray.origin.y(), ray.direction.y(), y_m_min(), y_m_max(), begin_m, end_m);
  if (begin_m > end_m) return std::nullopt;
  Axis x(ray.origin.x(), ray.direction.x(), begin_m, x_m_min(), grid_.cell_size_m,
         grid_.columns - 1);
  Axis y(ray.origin.y(), ray.direction.y(), begin_m, y_m_min(), grid_.cell_size_m, grid_.rows - 1);
  while (begin_m <= end_m) {
    const double leave_m = std::min({x.next_m, y.next_m, end_m});
    if (const auto range_m = CastPatch(ray, x.cell, y.cell, begin_m, std::max(begin_m, leave_m)))
      return range_m;
    if (leave_m >= end_m) return std::nullopt;
    Axis& axis = x.next_m < y.next_m ? x : y;
    const int cells = (&axis == &x ? grid_.columns : grid_.rows) - 1;
    axis.cell += axis.step;
    if (axis.cell < 0 || axis.cell >= cells) return std::nullopt;
    axis.next_m += axis.period_m;
    begin_m = std::max(begin_m, leave_m);
  }
  return std::nullopt;
}

}  // namespace gem
