#include "client/simulation/town_ground.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "client/formats/esri_ascii.h"
#include "core/base/check.h"

namespace gem {
namespace {

/// A raster of zeros about the way, as far as its ground reaches.
EsriAsciiGrid RasterAbout(const std::vector<Eigen::Vector3d>& way_m, const TownOptions& options) {
  Eigen::Vector2d low_m = way_m.front().head<2>();
  Eigen::Vector2d high_m = low_m;
  for (const Eigen::Vector3d& place_m : way_m) {
    low_m = low_m.cwiseMin(place_m.head<2>());
    high_m = high_m.cwiseMax(place_m.head<2>());
  }
  const double margin_m = options.reach_m + 2 * options.ground_cell_m;
  const auto cells = [&](int axis) {
    return static_cast<std::int32_t>(
        std::ceil((high_m[axis] - low_m[axis] + 2 * margin_m) / options.ground_cell_m));
  };
  EsriAsciiGrid grid{.columns = cells(0),
                     .rows = cells(1),
                     .x_m_min = low_m.x() - margin_m,
                     .y_m_min = low_m.y() - margin_m,
                     .cell_size_m = options.ground_cell_m,
                     .values = {},
                     .valid = {}};
  const std::size_t num_cells =
      static_cast<std::size_t>(grid.columns) * static_cast<std::size_t>(grid.rows);
  grid.values.resize(num_cells);
  grid.valid.resize(num_cells);
  return grid;
}

}  // namespace

std::unique_ptr<const GridTerrain> GroundAlong(const std::vector<Eigen::Vector3d>& way_m,
                                               const TownOptions& options) {
  GEM_CHECK(way_m.size() >= 2 && options.ground_cell_m > 0 && options.smoothing_m > 0);
  EsriAsciiGrid grid = RasterAbout(way_m, options);
  std::vector<double> weights(grid.values.size());
  std::vector<double> heights(grid.values.size());
  const double reach2 = options.reach_m * options.reach_m;
  const double smoothing2 = options.smoothing_m * options.smoothing_m;
  const auto middle = [&grid](double low_m, std::int32_t cell) {
    return low_m + (cell + 0.5) * grid.cell_size_m;
  };
  const auto cell_at = [&grid](double low_m, double at_m, std::int32_t cells) {
    return std::clamp(static_cast<std::int32_t>(std::floor((at_m - low_m) / grid.cell_size_m)), 0,
                      cells - 1);
  };
  for (const Eigen::Vector3d& place_m : way_m) {
    const auto row_min = cell_at(grid.y_m_min, place_m.y() - options.reach_m, grid.rows);
    const auto row_max = cell_at(grid.y_m_min, place_m.y() + options.reach_m, grid.rows);
    const auto column_min = cell_at(grid.x_m_min, place_m.x() - options.reach_m, grid.columns);
    const auto column_max = cell_at(grid.x_m_min, place_m.x() + options.reach_m, grid.columns);
    for (std::int32_t row = row_min; row <= row_max; ++row) {
      for (std::int32_t column = column_min; column <= column_max; ++column) {
        const double dx = middle(grid.x_m_min, column) - place_m.x();
        const double dy = middle(grid.y_m_min, row) - place_m.y();
        const double distance2 = dx * dx + dy * dy;
        if (distance2 >= reach2) continue;
        // Falls with the sixth power of the distance, and to zero where the ground ends, so that
        // no place of the way comes or goes with a step.
        const double near = 1 / (distance2 + smoothing2);
        const double taper = 1 - distance2 / reach2;
        const double weight = near * near * near * taper * taper;
        const std::size_t cell =
            static_cast<std::size_t>(row) * static_cast<std::size_t>(grid.columns) +
            static_cast<std::size_t>(column);
        weights[cell] += weight;
        heights[cell] += weight * place_m.z();
      }
    }
  }
  for (std::size_t cell = 0; cell < weights.size(); ++cell) {
    if (!(weights[cell] > 0)) continue;
    grid.values[cell] = static_cast<float>(heights[cell] / weights[cell]);
    grid.valid[cell] = 1;
  }
  return std::make_unique<const GridTerrain>(std::move(grid));
}

}  // namespace gem
