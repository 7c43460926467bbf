// Published maps that a test writes cell by cell.
#pragma once

#include <functional>
#include <memory>

#include "core/global/map_snapshot.h"

namespace gem::test {

inline CellBelief FreeCell(float elevation_m) {
  return {elevation_m, 0.01f, 1, 0, 0, kCellKnown | kCellAnnotated};
}
inline CellBelief Obstacle(float elevation_m, float traversability = 0.1f) {
  return {elevation_m, 0.01f, traversability, 0, 0, kCellKnown | kCellAnnotated};
}
inline CellBelief HeightOnly(float elevation_m) {
  return {elevation_m, 0.01f, 0, 0, 0, kCellKnown};
}

/// Cells of 0.5 m, unless it is said otherwise, all unknown at first; free above 0.7.
class TerrainScene {
 public:
  explicit TerrainScene(float cell_size_m = 0.5f) {
    map_.version = {7, 3};
    map_.options.cell_size_m = cell_size_m;
  }

  void Set(CellIndex cell, const CellBelief& belief) {
    std::shared_ptr<Tile>& tile = tiles_[TileOf(cell)];
    if (tile == nullptr) {
      tile = std::make_shared<Tile>(
          Tile{0, TileOf(cell), map_.version, std::vector<CellBelief>(kTileCells * kTileCells)});
      map_.tiles[tile->index] = tile;
    }
    tile->cells[static_cast<std::size_t>(IndexInTile(cell))] = belief;
  }
  /// Free cells [min, max) of the given height.
  void Fill(const CellRect& rect, const std::function<float(CellIndex)>& elevation_m) {
    for (CellIndex c = rect.min; c.y < rect.max.y; ++c.y)
      for (c.x = rect.min.x; c.x < rect.max.x; ++c.x) Set(c, FreeCell(elevation_m(c)));
  }
  void FillFlat(const CellRect& rect) {
    Fill(rect, [](CellIndex) { return 0.0f; });
  }

  const MapSnapshot& map() const { return map_; }

 private:
  MapSnapshot map_;
  absl::flat_hash_map<TileIndex, std::shared_ptr<Tile>> tiles_;
};

}  // namespace gem::test
