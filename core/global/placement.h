// A submap or a local map at its place in G, with the tiles that it touches there. Immutable: a
// correction makes new ones.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "core/geometry/pose.h"
#include "core/global/submap.h"
#include "core/grid/cell_index.h"
#include "core/local/local_map.h"

namespace gem {

struct PlacedSubmap {
  SubmapId id{};
  std::shared_ptr<const Submap> submap;
  bool finished = false;
  Pose<Global, Submap> T_G_K;
  CellRect rect_G;               ///< of cells of G
  std::vector<TileIndex> tiles;  ///< sorted
};

PlacedSubmap Place(SubmapId id, std::shared_ptr<const Submap> submap, bool finished,
                   const Pose<Global, Submap>& T_G_K);

/// Older first, by what the submaps are and not by when they arrived: the stamp of the anchor, then
/// the session. No two submaps of a map are equal.
bool Older(const Submap& a, const Submap& b);

/// Tiles on which `after` may differ from `before`: two states of one submap, or nothing (null).
void AppendChangedTiles(const PlacedSubmap* before, const PlacedSubmap* after,
                        std::vector<TileIndex>& tiles);

/// A local map as a height field for Gather: only its known cells count.
class LocalField {
 public:
  explicit LocalField(std::shared_ptr<const LocalMap> map);

  const LocalMap& map() const { return *map_; }
  const std::shared_ptr<const LocalMap>& shared_map() const { return map_; }
  bool empty() const { return rect_.empty(); }
  /// Smallest rectangle of cells of O that holds all known cells.
  const CellRect& rect() const { return rect_; }
  float elevation_m_min() const { return elevation_m_min_; }
  float elevation_m_max() const { return elevation_m_max_; }
  std::int64_t newest_ns() const { return newest_ns_; }

  std::optional<std::size_t> Find(CellIndex cell) const {
    if (!rect_.Contains(cell)) return std::nullopt;
    const std::size_t index = map_->IndexOf(cell);
    if ((map_->state[index] & kCellKnown) == 0) return std::nullopt;
    return index;
  }
  float elevation_m(std::size_t position) const { return map_->elevation_m[position]; }

 private:
  std::shared_ptr<const LocalMap> map_;
  CellRect rect_;
  float elevation_m_min_ = 0;
  float elevation_m_max_ = 0;
  std::int64_t newest_ns_ = 0;
};

struct PlacedLocalMap {
  std::string session;
  std::shared_ptr<const LocalField> field;
  Pose<Global, Odom> T_G_O;
  CellRect rect_G;
  std::vector<TileIndex> tiles;  ///< sorted
};

PlacedLocalMap Place(std::string session, std::shared_ptr<const LocalField> field,
                     const Pose<Global, Odom>& T_G_O);

}  // namespace gem
