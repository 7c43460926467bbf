#include "client/mirrored_map.h"

#include <cmath>

namespace gem::client {

std::optional<float> MirroredMap::ValueAt(Layer layer, const Place& place) const {
  // Beyond it no cell has an index; not a number is beyond it, too.
  if (!(std::abs(place.x_m) <= kCoordinateMax_m && std::abs(place.y_m) <= kCoordinateMax_m))
    return std::nullopt;
  const CellIndex cell = CellAt(place.x_m, place.y_m, cell_size_m);
  const auto tile = tiles.find(TileOf(cell));
  if (tile == tiles.end()) return std::nullopt;
  const GridLayer* values = tile->second.grid->Find(layer);
  const auto index = static_cast<std::size_t>(IndexInTile(cell));
  if (values == nullptr || values->values.empty() || values->valid[index] == 0) return std::nullopt;
  return values->values[index];
}

}  // namespace gem::client
