// A rectangle of cells by layers, as readers of the service get it: tile or local map, decoded.
// Not what mappers work on.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "absl/strings/string_view.h"
#include "core/grid/cell_belief.h"

namespace gem {

/// What a layer of a grid holds.
enum class Layer : std::uint8_t {
  kElevation,       ///< metres over z = 0 of the grid's frame
  kVariance,        ///< of the elevation, m^2
  kTraversability,  ///< 0 obstacle .. 1 flat
  kSlope,           ///< radians; local maps only
  kRoughness,       ///< metres; local maps only
  kColor,           ///< Rgba, alpha 255
  kAge,             ///< seconds between the last observation and the grid's stamp
};
inline constexpr std::array<absl::string_view, 7> kLayerNames = {
    "elevation", "variance", "traversability", "slope", "roughness", "color", "age"};

inline absl::string_view NameOf(Layer layer) {
  return kLayerNames[static_cast<std::size_t>(layer)];
}
/// Nothing for a name that is no layer's.
inline std::optional<Layer> ParseLayer(absl::string_view name) {
  for (std::size_t i = 0; i < kLayerNames.size(); ++i)
    if (kLayerNames[i] == name) return static_cast<Layer>(i);
  return std::nullopt;
}

/// Cells by rows from the lower left: index = row * columns + column.
struct GridLayer {
  Layer layer = Layer::kElevation;
  std::vector<std::uint8_t> valid;  ///< 1 where the cell has a value, else 0
  std::vector<float> values;        ///< 0 where not valid; empty for kColor
  std::vector<Rgba> colors;         ///< kColor only
  friend bool operator==(const GridLayer&, const GridLayer&) = default;
};

struct LayeredGrid {
  std::int32_t columns = 0;  ///< along x
  std::int32_t rows = 0;     ///< along y
  double cell_size_m = 0;
  std::vector<GridLayer> layers;
  std::int64_t stamp_ns = 0;  ///< ages count back from it

  std::size_t num_cells() const {
    return static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows);
  }
  /// Null if the grid has no such layer.
  const GridLayer* Find(Layer layer) const {
    for (const GridLayer& candidate : layers)
      if (candidate.layer == layer) return &candidate;
    return nullptr;
  }
};

}  // namespace gem
