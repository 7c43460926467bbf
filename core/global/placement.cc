#include "core/global/placement.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "core/base/check.h"
#include "core/global/coverage.h"
#include "core/global/gather.h"

namespace gem {
namespace {

void Extend(CellRect& rect, const CellRect& other) {
  if (other.empty()) return;
  if (rect.empty()) {
    rect = other;
    return;
  }
  rect = {{std::min(rect.min.x, other.min.x), std::min(rect.min.y, other.min.y)},
          {std::max(rect.max.x, other.max.x), std::max(rect.max.y, other.max.y)}};
}

// Of groups that the other submap does not hold alike. Lines that pass over a changed cell may meet
// another one behind it: the whole span of heights counts.
void AppendChangedGroups(const PlacedSubmap& placed, const Submap& other,
                         std::vector<TileIndex>& tiles) {
  const Submap& submap = *placed.submap;
  const Eigen::Matrix3d R_G_K = placed.T_G_K.matrix();
  for (const Submap::Group& group : submap.groups()) {
    if (SameGroup(submap, group, other)) continue;
    CellBox box = BoxOf(submap, group);
    box.elevation_m_min = std::min(submap.elevation_m_min(), other.elevation_m_min());
    box.elevation_m_max = std::max(submap.elevation_m_max(), other.elevation_m_max());
    AppendSquares(RectUnder(box, R_G_K, placed.T_G_K.translation(), submap.origin().cell_size_m),
                  kTileBits, tiles);
  }
}

}  // namespace

PlacedSubmap Place(SubmapId id, std::shared_ptr<const Submap> submap, bool finished,
                   const Pose<Global, Submap>& T_G_K) {
  PlacedSubmap placed{id, std::move(submap), finished, T_G_K, {}, {}};
  const Submap& content = *placed.submap;
  const Eigen::Matrix3d R_G_K = T_G_K.matrix();
  const double cell_size_m = content.origin().cell_size_m;
  if (!Gather(R_G_K, T_G_K.translation(), cell_size_m, 0, 0).upright()) return placed;
  for (const Submap::Group& group : content.groups()) {
    const CellRect rect = RectUnder(BoxOf(content, group), R_G_K, T_G_K.translation(), cell_size_m);
    Extend(placed.rect_G, rect);
    AppendSquares(rect, kTileBits, placed.tiles);
  }
  SortUnique(placed.tiles);
  return placed;
}

bool Older(const Submap& a, const Submap& b) {
  const SubmapOrigin& origin_a = a.origin();
  const SubmapOrigin& origin_b = b.origin();
  if (origin_a.anchor_stamp_ns != origin_b.anchor_stamp_ns)
    return origin_a.anchor_stamp_ns < origin_b.anchor_stamp_ns;
  return origin_a.session < origin_b.session;
}

void AppendChangedTiles(const PlacedSubmap* before, const PlacedSubmap* after,
                        std::vector<TileIndex>& tiles) {
  const auto append_all = [&tiles](const PlacedSubmap* placed) {
    if (placed != nullptr) tiles.insert(tiles.end(), placed->tiles.begin(), placed->tiles.end());
  };
  if (before == after) return;
  if (before == nullptr || after == nullptr || !Identical(before->T_G_K, after->T_G_K)) {
    append_all(before);
    append_all(after);
    return;
  }
  if (before->tiles.empty() && after->tiles.empty()) return;  // on its side: nothing shows
  AppendChangedGroups(*before, *after->submap, tiles);
  AppendChangedGroups(*after, *before->submap, tiles);
}

LocalField::LocalField(std::shared_ptr<const LocalMap> map) : map_(std::move(map)) {
  elevation_m_min_ = std::numeric_limits<float>::max();
  elevation_m_max_ = std::numeric_limits<float>::lowest();
  newest_ns_ = std::numeric_limits<std::int64_t>::min();
  std::size_t index = 0;
  for (std::int32_t row = 0; row < map_->side_cells; ++row) {
    for (std::int32_t column = 0; column < map_->side_cells; ++column, ++index) {
      if ((map_->state[index] & kCellKnown) == 0) continue;
      const CellIndex cell{map_->origin.x + column, map_->origin.y + row};
      Extend(rect_, {cell, {cell.x + 1, cell.y + 1}});
      elevation_m_min_ = std::min(elevation_m_min_, map_->elevation_m[index]);
      elevation_m_max_ = std::max(elevation_m_max_, map_->elevation_m[index]);
      newest_ns_ = std::max(newest_ns_, map_->observed_ns[index]);
    }
  }
}

PlacedLocalMap Place(std::string session, std::shared_ptr<const LocalField> field,
                     const Pose<Global, Odom>& T_G_O) {
  PlacedLocalMap placed{std::move(session), std::move(field), T_G_O, {}, {}};
  const LocalField& content = *placed.field;
  const Eigen::Matrix3d R_G_O = T_G_O.matrix();
  const double cell_size_m = content.map().cell_size_m;
  if (content.empty() || !Gather(R_G_O, T_G_O.translation(), cell_size_m, 0, 0).upright())
    return placed;
  placed.rect_G = RectUnder({content.rect(), content.elevation_m_min(), content.elevation_m_max()},
                            R_G_O, T_G_O.translation(), cell_size_m);
  AppendSquares(placed.rect_G, kTileBits, placed.tiles);
  return placed;
}

}  // namespace gem
