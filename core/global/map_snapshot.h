// A published version of the global map: immutable, so that readers hold no lock.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/container/flat_hash_map.h"
#include "core/base/check.h"
#include "core/geometry/pose.h"
#include "core/global/global_map_options.h"
#include "core/global/submap.h"
#include "core/grid/cell_belief.h"
#include "core/grid/map_version.h"

namespace gem {

/// 128x128 cells of G, by IndexInTile(). Elevation over z = 0 of G. A tile holds at least one known
/// cell.
struct Tile {
  int level = 0;  ///< 0 to kLevelMax
  TileIndex index;
  MapVersion version;             ///< of its last change
  std::vector<CellBelief> cells;  ///< kTileCells * kTileCells
};

inline TileAddress AddressOf(const Tile& tile) { return {tile.level, tile.index}; }

using TileMap = absl::flat_hash_map<TileIndex, std::shared_ptr<const Tile>>;

/// A submap as readers see it.
struct SubmapInfo {
  SubmapOrigin origin;
  ContributorSet contributors;  ///< of its cells
  Pose<Global, Submap> T_G_K;
  CellRect rect_G;  ///< of cells of G, holds all its cells; empty if it lies on its side
  std::uint64_t num_cells = 0;
  std::uint64_t size_bytes = 0;
  std::int64_t first_stamp_ns = 0;
  std::int64_t last_stamp_ns = 0;
  bool finished = false;
};

/// A session as readers see it.
struct SessionInfo {
  std::string session;
  std::string robot;
  Pose<Global, Odom> T_G_O;  ///< at its newest pose
  bool ended = false;
  bool retracted = false;  ///< what it contributed is hidden
};

struct MapSnapshot {
  MapVersion version;
  GlobalMapOptions options;
  TileMap tiles;                           ///< of level 0
  std::array<TileMap, kLevelMax> coarser;  ///< coarser[n - 1] is level n
  std::vector<SubmapInfo> submaps;         ///< by id
  std::vector<SessionInfo> sessions;       ///< by order of arrival
  std::uint64_t num_points = 0;            ///< cells in all submaps
  std::uint64_t submap_bytes = 0;          ///< what is hidden of them included
  std::int64_t newest_stamp_ns = 0;        ///< newest observation in the map

  /// The tiles of a level, 0 to kLevelMax.
  const TileMap& TilesOf(int level) const {
    GEM_CHECK(level >= 0 && level <= kLevelMax);
    return level == 0 ? tiles : coarser[static_cast<std::size_t>(level - 1)];
  }
};

}  // namespace gem
