#include "client/evaluation/revisits.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "absl/container/flat_hash_map.h"
#include "core/global/gather.h"
#include "core/global/placement.h"

namespace gem::evaluation {
namespace {

struct Passes {
  float first_m = 0;
  float later_m = 0;
  std::int64_t first_ns = 0;
  std::int64_t later_ns = 0;
  bool twice = false;
};

bool IsFree(const CellBelief& belief, const MapSnapshot& map) {
  return belief.annotated() && belief.traversability > map.options.traversability_free;
}

}  // namespace

std::vector<std::size_t> LoopClosures(const std::vector<Pose<Global, Base>>& poses,
                                      const std::vector<std::int64_t>& stamps_ns,
                                      const LoopRule& rule) {
  const auto gap_ns = static_cast<std::int64_t>(rule.gap_s * 1e9);
  std::vector<std::size_t> closures;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    if (!closures.empty() && i - closures.back() < rule.scans_between) continue;
    for (std::size_t k = 0; k < i && stamps_ns[i] - stamps_ns[k] > gap_ns; ++k) {
      if ((poses[i].translation() - poses[k].translation()).norm() > rule.radius_m) continue;
      closures.push_back(i);
      break;
    }
  }
  return closures;
}

std::vector<LaidSubmap> LaySubmaps(const SubmapRun& run, const MapSnapshot& map) {
  absl::flat_hash_map<std::int64_t, Pose<Global, Submap>> pose_of;
  for (const SubmapInfo& info : map.submaps) pose_of[info.origin.anchor_stamp_ns] = info.T_G_K;
  std::vector<LaidSubmap> laid;
  for (const SubmapRun::Finished& finished : run.finished) {
    const auto it = pose_of.find(finished.submap->origin().anchor_stamp_ns);
    if (it != pose_of.end()) laid.push_back({finished.submap, it->second});
  }
  return laid;
}

std::vector<TwicePassed> PassedTwice(const std::vector<LaidSubmap>& submaps, double cell_size_m,
                                     double gap_s, float traversability_free) {
  const auto gap_ns = static_cast<std::int64_t>(gap_s * 1e9);
  absl::flat_hash_map<std::uint64_t, std::size_t> index_of;
  std::vector<Passes> passes;
  std::vector<CellIndex> cells;
  for (const LaidSubmap& laid : submaps) {
    const PlacedSubmap placed = Place(SubmapId{1}, laid.submap, true, laid.T_G_K);
    const Submap& submap = *laid.submap;
    const Gather gather(laid.T_G_K.matrix(), laid.T_G_K.translation(), cell_size_m,
                        submap.elevation_m_min(), submap.elevation_m_max());
    if (!gather.upright()) continue;
    const CellRect& rect = placed.rect_G;
    for (CellIndex cell = rect.min; cell.y < rect.max.y; ++cell.y) {
      for (cell.x = rect.min.x; cell.x < rect.max.x; ++cell.x) {
        const std::optional<GatherHit> hit = gather.At(submap, cell);
        if (!hit) continue;
        const SubmapCell seen = submap.At(hit->position);
        if ((seen.state & kCellAnnotated) == 0 || seen.traversability <= traversability_free)
          continue;
        const auto [it, inserted] = index_of.try_emplace(PackedKey(cell), passes.size());
        if (inserted) {
          passes.push_back({hit->elevation_m, 0, seen.stamp_ns, 0, false});
          cells.push_back(cell);
          continue;
        }
        Passes& known = passes[it->second];
        if (seen.stamp_ns - known.first_ns < gap_ns) continue;
        if (known.twice && seen.stamp_ns < known.later_ns) continue;
        known.later_m = hit->elevation_m;
        known.later_ns = seen.stamp_ns;
        known.twice = true;
      }
    }
  }
  std::vector<TwicePassed> twice;
  for (std::size_t i = 0; i < passes.size(); ++i)
    if (passes[i].twice) twice.push_back({cells[i], passes[i].first_m, passes[i].later_m});
  return twice;
}

Deviation DeviationOf(std::vector<double> differences_m) {
  Deviation deviation;
  deviation.cells = differences_m.size();
  if (differences_m.empty()) return deviation;
  double sum2 = 0;
  for (double& difference_m : differences_m) {
    sum2 += difference_m * difference_m;
    difference_m = std::abs(difference_m);
  }
  std::sort(differences_m.begin(), differences_m.end());
  const auto at = [&](double share) {
    return differences_m[static_cast<std::size_t>(share *
                                                  static_cast<double>(differences_m.size() - 1))];
  };
  deviation.rms_m = std::sqrt(sum2 / static_cast<double>(differences_m.size()));
  deviation.median_m = at(0.5);
  deviation.p95_m = at(0.95);
  return deviation;
}

Deviation DeviationOf(const std::vector<TwicePassed>& cells) {
  std::vector<double> differences_m;
  differences_m.reserve(cells.size());
  for (const TwicePassed& cell : cells)
    differences_m.push_back(static_cast<double>(cell.later_m) - cell.first_m);
  return DeviationOf(std::move(differences_m));
}

Deviation ErrorAgainst(const MapSnapshot& map,
                       const std::function<std::optional<double>(double, double)>& truth) {
  const double cell_size_m = map.options.cell_size_m;
  std::vector<double> differences_m;
  for (const auto& [index, tile] : map.tiles) {
    const CellIndex origin = OriginOf(index);
    for (std::size_t i = 0; i < tile->cells.size(); ++i) {
      const CellBelief& belief = tile->cells[i];
      if (!IsFree(belief, map)) continue;
      const auto offset = static_cast<std::int32_t>(i);
      const double x_m = CenterOf(origin.x + offset % kTileCells, cell_size_m);
      const double y_m = CenterOf(origin.y + offset / kTileCells, cell_size_m);
      if (const auto height_m = truth(x_m, y_m))
        differences_m.push_back(belief.elevation_m - *height_m);
    }
  }
  return DeviationOf(std::move(differences_m));
}

Deviation DeviationBetween(const MapSnapshot& a, const MapSnapshot& b) {
  std::vector<double> differences_m;
  for (const auto& [index, tile] : a.tiles) {
    const auto other = b.tiles.find(index);
    if (other == b.tiles.end()) continue;
    for (std::size_t i = 0; i < tile->cells.size(); ++i) {
      const CellBelief& in_a = tile->cells[i];
      const CellBelief& in_b = other->second->cells[i];
      if (IsFree(in_a, a) && IsFree(in_b, b))
        differences_m.push_back(static_cast<double>(in_b.elevation_m) - in_a.elevation_m);
    }
  }
  return DeviationOf(std::move(differences_m));
}

std::size_t CellsThatDiffer(const MapSnapshot& a, const MapSnapshot& b) {
  const std::vector<CellBelief> unknown(kTileCells * kTileCells);
  const auto cells_of = [&unknown](const MapSnapshot& map, TileIndex tile) {
    const auto it = map.tiles.find(tile);
    return it == map.tiles.end() ? &unknown : &it->second->cells;
  };
  std::size_t num_differ = 0;
  const auto compare = [&](TileIndex tile) {
    const std::vector<CellBelief>& in_a = *cells_of(a, tile);
    const std::vector<CellBelief>& in_b = *cells_of(b, tile);
    for (std::size_t i = 0; i < in_a.size(); ++i)
      if (!(in_a[i] == in_b[i])) ++num_differ;
  };
  for (const auto& [index, tile] : a.tiles) compare(index);
  for (const auto& [index, tile] : b.tiles)
    if (!a.tiles.contains(index)) compare(index);
  return num_differ;
}

}  // namespace gem::evaluation
