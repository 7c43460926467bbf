// Tiny grids for the tests of exports and pictures.
#pragma once

#include <optional>
#include <vector>

#include "client/placed_grid.h"

namespace gem::client {

/// A layer from values by rows from the lower left; nothing: not valid.
inline GridLayer LayerOf(Layer layer, const std::vector<std::optional<float>>& values) {
  GridLayer made{layer, {}, {}, {}};
  for (const std::optional<float>& value : values) {
    made.valid.push_back(value.has_value() ? 1 : 0);
    made.values.push_back(value.value_or(0));
  }
  return made;
}

/// Elevation and traversability; cells of 0.5 m, origin (-1, 2), free above 0.7.
inline PlacedGrid GridOf(std::int32_t columns, const std::vector<std::optional<float>>& elevation,
                         const std::vector<std::optional<float>>& traversability) {
  PlacedGrid placed;
  placed.grid.columns = columns;
  placed.grid.rows = static_cast<std::int32_t>(elevation.size()) / columns;
  placed.grid.cell_size_m = 0.5;
  placed.grid.layers = {LayerOf(Layer::kElevation, elevation),
                        LayerOf(Layer::kTraversability, traversability)};
  placed.origin = {-1, 2};
  placed.traversability_free = 0.7f;
  return placed;
}

}  // namespace gem::client
