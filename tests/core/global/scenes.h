// Submaps, local maps and snapshots for the tests of the global mapper, by name and number.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "core/geometry/pose.h"
#include "core/global/map_snapshot.h"
#include "core/global/submap.h"
#include "core/local/local_map.h"

namespace gem::test {

constexpr std::int64_t kSecond_ns = 1'000'000'000;

/// Height in K of a cell of K.
using HeightOf = std::function<float(CellIndex)>;

inline HeightOf Flat(float elevation_m) {
  return [elevation_m](CellIndex) { return elevation_m; };
}

inline SubmapCell Cell(float elevation_m, std::int64_t stamp_ns, float variance_m2 = 0.01f) {
  SubmapCell cell;
  cell.elevation_m = elevation_m;
  cell.covariance_m2 = {0.003f, 0, 0, 0.003f, 0, variance_m2};
  cell.traversability = 1.0f;
  cell.stamp_ns = stamp_ns;
  cell.state = kCellKnown | kCellAnnotated;
  return cell;
}

/// A submap that knows every cell of the rectangle. T_O_K: where K lies; cells of 0.2 m.
inline std::shared_ptr<const Submap> MakeSubmap(const std::string& session,
                                                std::int64_t anchor_stamp_ns,
                                                const Pose<Odom, Submap>& T_O_K,
                                                const CellRect& rect, const HeightOf& height_of,
                                                std::int64_t stamp_ns = 0) {
  SubmapOrigin origin;
  origin.session = session;
  origin.robot = "robot-" + session;
  origin.anchor_stamp_ns = anchor_stamp_ns;
  origin.T_O_K = T_O_K;
  origin.cell_size_m = 0.2f;
  std::vector<KeyedSubmapCell> cells;
  for (CellIndex c = rect.min; c.y < rect.max.y; ++c.y)
    for (c.x = rect.min.x; c.x < rect.max.x; ++c.x)
      cells.push_back({c, Cell(height_of(c), stamp_ns == 0 ? anchor_stamp_ns : stamp_ns)});
  return std::make_shared<const Submap>(std::move(origin), cells);
}

/// K at whole cells of O.
inline Pose<Odom, Submap> AtCells(std::int32_t x, std::int32_t y, double z_m = 0) {
  const double cell_size_m = 0.2f;
  return Pose<Odom, Submap>::FromTranslation(x * cell_size_m, y * cell_size_m, z_m);
}

/// A local map of 0.2 m cells that knows every cell of its window at one height.
inline std::shared_ptr<const LocalMap> MakeLocalMap(CellIndex origin, std::int32_t side_cells,
                                                    float elevation_m, std::int64_t stamp_ns) {
  LocalMap map;
  map.stamp_ns = stamp_ns;
  map.origin = origin;
  map.side_cells = side_cells;
  map.cell_size_m = 0.2f;
  const auto num_cells = static_cast<std::size_t>(side_cells * side_cells);
  map.state.assign(num_cells, kCellKnown);
  map.elevation_m.assign(num_cells, elevation_m);
  map.variance_m2.assign(num_cells, 0.01f);
  map.slope_rad.assign(num_cells, 0);
  map.roughness_m.assign(num_cells, 0);
  map.traversability.assign(num_cells, 0);
  map.rgba.assign(num_cells, 0);
  map.observed_ns.assign(num_cells, stamp_ns);
  return std::make_shared<const LocalMap>(std::move(map));
}

/// Unknown where there is no tile.
inline CellBelief CellOfMap(const MapSnapshot& snapshot, CellIndex cell) {
  const auto it = snapshot.tiles.find(TileOf(cell));
  if (it == snapshot.tiles.end()) return {};
  return it->second->cells[static_cast<std::size_t>(IndexInTile(cell))];
}

inline std::size_t NumKnown(const MapSnapshot& snapshot) {
  std::size_t known = 0;
  for (const auto& [index, tile] : snapshot.tiles)
    for (const CellBelief& cell : tile->cells) known += cell.known() ? 1 : 0;
  return known;
}

/// Same tiles with the same cells; versions may differ.
inline bool SameCells(const TileMap& a, const TileMap& b) {
  if (a.size() != b.size()) return false;
  for (const auto& [index, tile] : a) {
    const auto other = b.find(index);
    if (other == b.end() || other->second->cells != tile->cells) return false;
  }
  return true;
}
inline bool SameCells(const MapSnapshot& a, const MapSnapshot& b) {
  return SameCells(a.tiles, b.tiles);
}
/// The same at every level.
inline bool SameLevels(const MapSnapshot& a, const MapSnapshot& b) {
  for (int level = 0; level <= kLevelMax; ++level)
    if (!SameCells(a.TilesOf(level), b.TilesOf(level))) return false;
  return true;
}

}  // namespace gem::test
