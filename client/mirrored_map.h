// One version of a region of a map, as a mirror holds it: immutable, so that any thread may read it
// for as long as it likes.
#pragma once

#include <optional>

#include "absl/container/flat_hash_map.h"
#include "client/map_types.h"
#include "core/grid/cell_index.h"
#include "core/grid/layered_grid.h"
#include "core/grid/map_version.h"
#include "core/grid/terrain.h"

namespace gem::client {

struct MirroredMap {
  MapVersion version;
  int level = 0;                  ///< of the pyramid
  double cell_size_m = 0;         ///< at that level
  float traversability_free = 0;  ///< cells above this are free
  /// Every tile of the region with known cells; all have a grid with the layers that were asked
  /// for.
  absl::flat_hash_map<TileIndex, MapTile> tiles;

  /// Of the cell at a place of G; nothing if it has no value, or the layer was not asked for. Not
  /// for colours.
  std::optional<float> ValueAt(Layer layer, const Place& place) const;
  /// Known and free. False for everything that is not known, and without Layer::kTraversability.
  bool IsFree(const Place& place) const {
    return ValueAt(Layer::kTraversability, place).value_or(0) > traversability_free;
  }
};

}  // namespace gem::client
