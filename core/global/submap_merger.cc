#include "core/global/submap_merger.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <utility>

#include "absl/container/flat_hash_map.h"
#include "core/global/coverage.h"
#include "core/global/fusion.h"
#include "core/global/gather.h"
#include "core/global/sources.h"

namespace gem {
namespace {

// A crossing street may be nearer than the street itself, driven again: a few more are tried.
constexpr std::size_t kNeighbours_max = 4;

Eigen::Matrix3d RotationBetween(const PlacedSubmap& older, const PlacedSubmap& newer) {
  return older.T_G_K.matrix().transpose() * newer.T_G_K.matrix();
}

Eigen::Vector3d TranslationBetween(const PlacedSubmap& older, const PlacedSubmap& newer) {
  return older.T_G_K.matrix().transpose() * (newer.T_G_K.translation() - older.T_G_K.translation());
}

Covariance3 Rotate(const Eigen::Matrix3d& R, const Covariance3& c) {
  Eigen::Matrix3d covariance;
  covariance << c[0], c[1], c[2], c[1], c[3], c[4], c[2], c[4], c[5];
  const Eigen::Matrix3d rotated = R * covariance * R.transpose();
  return {static_cast<float>(rotated(0, 0)), static_cast<float>(rotated(0, 1)),
          static_cast<float>(rotated(0, 2)), static_cast<float>(rotated(1, 1)),
          static_cast<float>(rotated(1, 2)), static_cast<float>(rotated(2, 2))};
}

// Puts what came in to what is stored: fused where they agree, else the newest.
void Join(KeyedSubmapCell& stored, const KeyedSubmapCell& incoming, const GlobalMapOptions& options,
          JoinedSources& sources) {
  const bool stored_is_newer = stored.value.stamp_ns > incoming.value.stamp_ns;
  const SubmapCell& newest = stored_is_newer ? stored.value : incoming.value;
  const SubmapCell& oldest = stored_is_newer ? incoming.value : stored.value;
  const double gap_s = 1e-9 * static_cast<double>(newest.stamp_ns - oldest.stamp_ns);
  const bool agree =
      Agree(newest.elevation_m, HeightVariance(newest.covariance_m2), oldest.elevation_m,
            HeightVariance(oldest.covariance_m2), options.gate_sigmas);
  if (agree && gap_s <= options.merge_fuse_time_s_max) {
    stored.value = Fuse(newest, oldest);
    stored.source = sources.Union(stored.source, incoming.source);
  } else if (!stored_is_newer) {
    stored.value = incoming.value;
    stored.source = incoming.source;
  }
}

// The older submap's cells under the newer one, by group, so that a long thin submap across costs
// what it covers.
std::vector<CellIndex> GroupsUnder(const Submap& newer, const Eigen::Matrix3d& R,
                                   const Eigen::Vector3d& t) {
  std::vector<CellIndex> groups;
  for (const Submap::Group& group : newer.groups())
    AppendSquares(RectUnder(BoxOf(newer, group), R, t, newer.origin().cell_size_m), kGroupBits,
                  groups);
  SortUnique(groups);
  return groups;
}

// How the newer submap lies on another one.
struct Onto {
  Onto(const PlacedSubmap& below, const PlacedSubmap& newer)
      : R(RotationBetween(below, newer)),
        t(TranslationBetween(below, newer)),
        gather(R, t, below.submap->origin().cell_size_m, newer.submap->elevation_m_min(),
               newer.submap->elevation_m_max()) {}
  Eigen::Matrix3d R;
  Eigen::Vector3d t;
  Gather gather;
};

// Calls visit(KeyedSubmapCell) for every cell of the frame of `below` that the newer submap knows.
template <typename Visit>
void ForEachIncoming(const PlacedSubmap& below, const PlacedSubmap& newer,
                     const JoinedSources& sources, const Visit& visit) {
  const Onto onto(below, newer);
  const Submap& from = *newer.submap;
  for (const CellIndex group : GroupsUnder(from, onto.R, onto.t)) {
    for (std::int32_t i = 0; i < kGroupCells * kGroupCells; ++i) {
      const CellIndex cell{(group.x << kGroupBits) + (i & (kGroupCells - 1)),
                           (group.y << kGroupBits) + (i >> kGroupBits)};
      const std::optional<GatherHit> hit = onto.gather.At(from, cell);
      if (!hit) continue;
      KeyedSubmapCell incoming{cell, from.At(hit->position),
                               sources.OfNewer(from.source(hit->position))};
      incoming.value.elevation_m = hit->elevation_m;
      incoming.value.covariance_m2 = Rotate(onto.R, incoming.value.covariance_m2);
      visit(incoming);
    }
  }
}

// Whether one of the submaps knows the place of a cell of `placed`.
bool KnownTo(const std::vector<std::shared_ptr<const PlacedSubmap>>& others,
             const PlacedSubmap& placed, CellIndex cell, float elevation_m) {
  if (others.empty()) return false;
  const double cell_size_m = placed.submap->origin().cell_size_m;
  const Point<Submap> p_K(CenterOf(cell.x, cell_size_m), CenterOf(cell.y, cell_size_m),
                          elevation_m);
  const Point<Global> p_G = placed.T_G_K * p_K;
  for (const auto& other : others) {
    const Eigen::Vector3d p =
        other->T_G_K.rotation().conjugate() * (p_G.xyz() - other->T_G_K.translation());
    if (other->submap->Find(CellAt(p.x(), p.y(), cell_size_m))) return true;
  }
  return false;
}

bool Fits(const std::vector<KeyedSubmapCell>& cells) {
  const auto by_x = [](const KeyedSubmapCell& a, const KeyedSubmapCell& b) {
    return a.cell.x < b.cell.x;
  };
  const auto by_y = [](const KeyedSubmapCell& a, const KeyedSubmapCell& b) {
    return a.cell.y < b.cell.y;
  };
  const auto [x_min, x_max] = std::minmax_element(cells.begin(), cells.end(), by_x);
  const auto [y_min, y_max] = std::minmax_element(cells.begin(), cells.end(), by_y);
  const auto side = [](std::int32_t min, std::int32_t max) {
    return static_cast<std::int64_t>(max) - min + 1;
  };
  return side(x_min->cell.x, x_max->cell.x) <= kSubmapSideCells_max &&
         side(y_min->cell.y, y_max->cell.y) <= kSubmapSideCells_max;
}

bool Overlap(const CellRect& a, const CellRect& b) {
  return a.min.x < b.max.x && b.min.x < a.max.x && a.min.y < b.max.y && b.min.y < a.max.y;
}

// Between the middles of the bounding boxes, in half cells, squared.
double SquaredDistance(const CellRect& a, const CellRect& b) {
  const double dx = static_cast<double>(a.min.x) + a.max.x - b.min.x - b.max.x;
  const double dy = static_cast<double>(a.min.y) + a.max.y - b.min.y - b.max.y;
  return dx * dx + dy * dy;
}

// The finished submaps of a map while they are merged, found by tile.
class Neighbourhood {
 public:
  explicit Neighbourhood(const std::vector<std::shared_ptr<const PlacedSubmap>>& submaps) {
    for (const auto& placed : submaps) Put(placed);
  }

  std::shared_ptr<const PlacedSubmap> Shared(SubmapId id) const {
    const auto it = by_id_.find(id);
    return it == by_id_.end() ? nullptr : it->second;
  }

  void Put(const std::shared_ptr<const PlacedSubmap>& placed) {
    by_id_[placed->id] = placed;
    if (!placed->finished) return;
    for (const TileIndex tile : placed->tiles) {
      std::vector<SubmapId>& ids = by_tile_[tile];
      if (std::find(ids.begin(), ids.end(), placed->id) == ids.end()) ids.push_back(placed->id);
    }
  }
  void Remove(SubmapId id) { by_id_.erase(id); }

  // Nearest first.
  std::vector<std::shared_ptr<const PlacedSubmap>> NeighboursOf(const PlacedSubmap& placed) const {
    std::vector<SubmapId> ids;
    for (const TileIndex tile : placed.tiles) {
      const std::vector<SubmapId>& here = by_tile_.at(tile);
      ids.insert(ids.end(), here.begin(), here.end());
    }
    std::sort(ids.begin(), ids.end());
    ids.erase(std::unique(ids.begin(), ids.end()), ids.end());

    std::vector<std::shared_ptr<const PlacedSubmap>> neighbours;
    for (const SubmapId id : ids) {
      std::shared_ptr<const PlacedSubmap> other = Shared(id);
      if (other != nullptr && id != placed.id && Overlap(other->rect_G, placed.rect_G))
        neighbours.push_back(std::move(other));
    }
    std::sort(neighbours.begin(), neighbours.end(), [&placed](const auto& a, const auto& b) {
      const double distance_a = SquaredDistance(a->rect_G, placed.rect_G);
      const double distance_b = SquaredDistance(b->rect_G, placed.rect_G);
      if (distance_a != distance_b) return distance_a < distance_b;
      return Older(*a->submap, *b->submap);
    });
    return neighbours;
  }

 private:
  absl::flat_hash_map<SubmapId, std::shared_ptr<const PlacedSubmap>> by_id_;
  absl::flat_hash_map<TileIndex, std::vector<SubmapId>> by_tile_;  ///< may name removed ones
};

// True if at least `wanted` cells of the newer submap lie on known cells of the older one, and the
// median of their height differences is small.
bool LieOnEachOther(const PlacedSubmap& older, const PlacedSubmap& newer, std::size_t wanted,
                    const GlobalMapOptions& options) {
  const Eigen::Matrix3d R = RotationBetween(older, newer);
  const Eigen::Vector3d t = TranslationBetween(older, newer);
  const Submap& below = *older.submap;
  const Submap& above = *newer.submap;
  const double cell_size_m = below.origin().cell_size_m;

  // Most neighbours only touch: their groups tell without looking at cells.
  std::vector<const Submap::Group*> near;
  std::size_t num_left = 0;
  for (const Submap::Group& group : above.groups()) {
    CellRect rect = RectUnder(BoxOf(above, group), R, t, cell_size_m);
    // Of cells with their middle under the group; its points may lie in the next ones.
    rect = {{rect.min.x - 1, rect.min.y - 1}, {rect.max.x + 1, rect.max.y + 1}};
    if (!below.MayKnowAnyOf(rect)) continue;
    near.push_back(&group);
    num_left += group.num_cells();
  }

  std::vector<double> differences_m;
  for (const Submap::Group* group : near) {
    // No use going on when even all the others would not suffice.
    if (differences_m.size() + num_left < wanted) return false;
    num_left -= group->num_cells();
    group->ForEachCell([&](CellIndex cell, std::size_t position) {
      const Eigen::Vector3d p_K(CenterOf(cell.x, cell_size_m), CenterOf(cell.y, cell_size_m),
                                above.elevation_m(position));
      const Eigen::Vector3d p = R * p_K + t;
      const double x = std::floor(p.x() / cell_size_m);
      const double y = std::floor(p.y() / cell_size_m);
      const CellRect& rect = below.rect();
      if (!(x >= rect.min.x && x < rect.max.x && y >= rect.min.y && y < rect.max.y)) return;
      const auto there = below.Find({static_cast<std::int32_t>(x), static_cast<std::int32_t>(y)});
      if (there) differences_m.push_back(std::abs(p.z() - below.elevation_m(*there)));
    });
  }
  if (differences_m.empty() || differences_m.size() < wanted) return false;
  const auto middle = differences_m.begin() + static_cast<std::ptrdiff_t>(differences_m.size() / 2);
  std::nth_element(differences_m.begin(), middle, differences_m.end());
  return *middle <= static_cast<double>(options.merge_height_difference_m_max);
}

std::size_t WantedOverlap(const PlacedSubmap& newer, const GlobalMapOptions& options) {
  const double cells = std::ceil(static_cast<double>(options.merge_overlap_min) *
                                 static_cast<double>(newer.submap->num_cells()));
  return std::max<std::size_t>(static_cast<std::size_t>(cells), 1);
}

bool SameGround(const PlacedSubmap& a, const PlacedSubmap& b, const GlobalMapOptions& options) {
  return LieOnEachOther(a, b, 1, options);
}

using Neighbours = std::vector<std::shared_ptr<const PlacedSubmap>>;

// Number of cells of the submap that one of the others knows.
std::size_t NumKnownTo(const Neighbours& others, const PlacedSubmap& placed) {
  std::size_t count = 0;
  for (const Submap::Group& group : placed.submap->groups())
    group.ForEachCell([&](CellIndex cell, std::size_t position) {
      if (KnownTo(others, placed, cell, placed.submap->elevation_m(position))) ++count;
    });
  return count;
}

// The one of the pair that goes is merged into the one that stays; what of it lies on the ground of
// others goes there. False if the result would grow too large.
bool MergePair(const PlacedSubmap& older, const PlacedSubmap& newer,
               const GlobalMapOptions& options, Neighbourhood& neighbourhood) {
  Neighbours others;
  for (auto& near : neighbourhood.NeighboursOf(newer))
    if (near->id != older.id && SameGround(*near, newer, options))
      others.push_back(std::move(near));
  std::shared_ptr<const Submap> merged = Merge(older, newer, options, others);
  if (merged == nullptr) return false;
  neighbourhood.Put(
      std::make_shared<const PlacedSubmap>(Place(older.id, std::move(merged), true, older.T_G_K)));
  for (const auto& near : others)
    neighbourhood.Put(std::make_shared<const PlacedSubmap>(
        Place(near->id, Refresh(*near, newer, options), true, near->T_G_K)));
  neighbourhood.Remove(newer.id);
  return true;
}

// A street driven again lies on two or three submaps of before, on none of them by half: it goes to
// the one that knows the most of it.
bool MergeIntoSeveral(const PlacedSubmap& subject, const Neighbours& neighbours,
                      const GlobalMapOptions& options, Neighbourhood& neighbourhood) {
  Neighbours olders;
  for (const auto& near : neighbours)
    if (Older(*near->submap, *subject.submap) && SameGround(*near, subject, options))
      olders.push_back(near);
  if (olders.size() < 2 || NumKnownTo(olders, subject) < WantedOverlap(subject, options))
    return false;
  std::size_t most = 0;
  std::shared_ptr<const PlacedSubmap> best;
  for (const auto& older : olders) {
    const std::size_t count = NumKnownTo({older}, subject);
    if (count > most) best = older;
    most = std::max(most, count);
  }
  return best != nullptr && MergePair(*best, subject, options, neighbourhood);
}

// Merges one submap with the nearest one that it should be merged with. True if it did.
bool MergeOne(const PlacedSubmap& subject, const GlobalMapOptions& options,
              Neighbourhood& neighbourhood) {
  const Neighbours neighbours = neighbourhood.NeighboursOf(subject);
  for (std::size_t i = 0; i < std::min(neighbours.size(), kNeighbours_max); ++i) {
    const PlacedSubmap& other = *neighbours[i];
    const bool subject_is_older = Older(*subject.submap, *other.submap);
    const PlacedSubmap& older = subject_is_older ? subject : other;
    const PlacedSubmap& newer = subject_is_older ? other : subject;
    if (ShouldMerge(older, newer, options) && MergePair(older, newer, options, neighbourhood))
      return true;
  }
  return MergeIntoSeveral(subject, neighbours, options, neighbourhood);
}

}  // namespace

bool ShouldMerge(const PlacedSubmap& older, const PlacedSubmap& newer,
                 const GlobalMapOptions& options) {
  return LieOnEachOther(older, newer, WantedOverlap(newer, options), options);
}

std::shared_ptr<const Submap> Merge(
    const PlacedSubmap& older, const PlacedSubmap& newer, const GlobalMapOptions& options,
    const std::vector<std::shared_ptr<const PlacedSubmap>>& others) {
  const Submap& into = *older.submap;
  if (!Onto(older, newer).gather.upright()) return nullptr;
  JoinedSources sources(into.sources(), newer.submap->sources());
  std::vector<KeyedSubmapCell> cells = into.Cells();  // by position
  ForEachIncoming(older, newer, sources, [&](const KeyedSubmapCell& incoming) {
    if (const std::optional<std::size_t> stored = into.Find(incoming.cell)) {
      Join(cells[*stored], incoming, options, sources);
    } else if (!KnownTo(others, older, incoming.cell, incoming.value.elevation_m)) {
      cells.push_back(incoming);
    }
  });
  if (sources.full() || !Fits(cells)) return nullptr;
  return std::make_shared<const Submap>(into.origin(), cells, into.parts(), sources.Take());
}

std::shared_ptr<const Submap> Refresh(const PlacedSubmap& stored, const PlacedSubmap& newer,
                                      const GlobalMapOptions& options) {
  const Submap& into = *stored.submap;
  if (!Onto(stored, newer).gather.upright()) return stored.submap;
  JoinedSources sources(into.sources(), newer.submap->sources());
  std::vector<KeyedSubmapCell> cells = into.Cells();  // by position
  ForEachIncoming(stored, newer, sources, [&](const KeyedSubmapCell& incoming) {
    if (const std::optional<std::size_t> position = into.Find(incoming.cell))
      Join(cells[*position], incoming, options, sources);
  });
  if (sources.full()) return stored.submap;
  return std::make_shared<const Submap>(into.origin(), cells, into.parts(), sources.Take());
}

Maintenance Maintain(std::vector<std::shared_ptr<const PlacedSubmap>> submaps,
                     const absl::flat_hash_set<SubmapId>& changed, const GlobalMapOptions& options,
                     const CancelToken& cancel) {
  if (changed.empty() || options.merge_overlap_min > 1) return {std::move(submaps), 0, false};
  std::vector<std::shared_ptr<const PlacedSubmap>> order;
  for (const auto& placed : submaps)
    if (placed->finished && changed.contains(placed->id)) order.push_back(placed);
  std::sort(order.begin(), order.end(),
            [](const auto& a, const auto& b) { return Older(*a->submap, *b->submap); });

  Neighbourhood neighbourhood(submaps);
  Maintenance result;
  for (const auto& placed : order) {
    if (cancel.cancelled()) return {{}, 0, true};
    // It may be gone by now, or have grown.
    const std::shared_ptr<const PlacedSubmap> subject = neighbourhood.Shared(placed->id);
    if (subject != nullptr && MergeOne(*subject, options, neighbourhood)) ++result.num_merged;
  }
  for (const auto& placed : submaps)
    if (auto left = neighbourhood.Shared(placed->id)) result.submaps.push_back(std::move(left));
  return result;
}

}  // namespace gem
