#include "core/global/pyramid.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <memory>
#include <utility>

#include "core/base/parallel_for.h"

namespace gem {
namespace {

/// A height that is certain would silence its neighbours with an infinite weight.
constexpr float kVarianceMin_m2 = 1e-9f;

double WeightOf(const CellBelief& cell) {
  return 1.0 / static_cast<double>(std::max(cell.variance_m2, kVarianceMin_m2));
}

void CoarsenHeight(const std::array<const CellBelief*, 4>& finer, CellBelief& coarse) {
  double weights = 0, heights = 0;
  for (const CellBelief* cell : finer) {
    if (!cell->known()) continue;
    const double weight = WeightOf(*cell);
    weights += weight;
    heights += weight * static_cast<double>(cell->elevation_m);
  }
  const double mean_m = heights / weights;
  double spread = 0;
  for (const CellBelief* cell : finer) {
    if (!cell->known()) continue;
    const double off_m = static_cast<double>(cell->elevation_m) - mean_m;
    spread += WeightOf(*cell) * (static_cast<double>(cell->variance_m2) + off_m * off_m);
  }
  coarse.elevation_m = static_cast<float>(mean_m);
  coarse.variance_m2 = static_cast<float>(spread / weights);
}

void CoarsenTraversability(const std::array<const CellBelief*, 4>& finer, float traversability_free,
                           CellBelief& coarse) {
  int num_annotated = 0;
  float lowest = 1;
  for (const CellBelief* cell : finer) {
    if (!cell->annotated()) continue;
    ++num_annotated;
    lowest = std::min(lowest, cell->traversability);
  }
  if (num_annotated == 0 || (num_annotated < 4 && lowest > traversability_free)) return;
  coarse.traversability = lowest;
  coarse.state |= kCellAnnotated;
}

void CoarsenColor(const std::array<const CellBelief*, 4>& finer, CellBelief& coarse) {
  double weights = 0;
  std::array<double, 3> channels = {};
  for (const CellBelief* cell : finer) {
    if (!cell->colored()) continue;
    const double weight = WeightOf(*cell);
    weights += weight;
    for (std::size_t i = 0; i < channels.size(); ++i)
      channels[i] += weight * ((cell->rgba >> (8 * i)) & 0xffu);
  }
  if (weights == 0) return;
  coarse.rgba = 0xff000000u;
  for (std::size_t i = 0; i < channels.size(); ++i)
    coarse.rgba |= static_cast<Rgba>(std::lround(channels[i] / weights)) << (8 * i);
  coarse.state |= kCellColored;
}

constexpr std::int32_t kHalf = kTileCells / 2;

/// Cell of a parent in the quarter that its child (0 or 1 along x and y) covers.
std::size_t IndexInQuarter(CellIndex child, std::int32_t row, std::int32_t column) {
  return static_cast<std::size_t>(IndexInTile({child.x * kHalf + column, child.y * kHalf + row}));
}

void CoarsenInto(const Tile& child, CellIndex quarter, float traversability_free,
                 std::vector<CellBelief>& cells) {
  for (std::int32_t row = 0; row < kHalf; ++row) {
    const CellBelief* lower = &child.cells[static_cast<std::size_t>(2 * row * kTileCells)];
    const CellBelief* upper = lower + kTileCells;
    CellBelief* coarse = &cells[IndexInQuarter(quarter, row, 0)];
    for (std::int32_t column = 0; column < kHalf; ++column, ++coarse, lower += 2, upper += 2)
      *coarse = Coarsen({lower, lower + 1, upper, upper + 1}, traversability_free);
  }
}

void CopyQuarter(const Tile& from, CellIndex quarter, std::vector<CellBelief>& cells) {
  for (std::int32_t row = 0; row < kHalf; ++row) {
    const std::size_t begin = IndexInQuarter(quarter, row, 0);
    std::copy_n(&from.cells[begin], kHalf, &cells[begin]);
  }
}

const std::shared_ptr<const Tile>* Find(const TileMap& tiles, TileIndex index) {
  const auto it = tiles.find(index);
  return it == tiles.end() ? nullptr : &it->second;
}

/// One level, and what of the level below differs.
struct Step {
  int level;
  const TileMap& finer;
  const std::vector<TileIndex>& changed;  // of the finer level, sorted
  const TileMap& old;
  MapVersion version;
  float traversability_free;

  /// Null: nothing is known there.
  std::shared_ptr<const Tile> Build(TileIndex index) const {
    const std::shared_ptr<const Tile>* before = Find(old, index);
    const TileIndex first = FirstChildOf(index);
    std::vector<CellBelief> cells;
    for (const CellIndex quarter : {CellIndex{0, 0}, {1, 0}, {0, 1}, {1, 1}}) {
      const TileIndex child_index{first.x + quarter.x, first.y + quarter.y};
      const std::shared_ptr<const Tile>* child = Find(finer, child_index);
      if (child == nullptr) continue;
      if (cells.empty()) cells.resize(kTileCells * kTileCells);
      if (before != nullptr && !std::binary_search(changed.begin(), changed.end(), child_index)) {
        CopyQuarter(**before, quarter, cells);
      } else {
        CoarsenInto(**child, quarter, traversability_free, cells);
      }
    }
    if (cells.empty()) return nullptr;
    if (before != nullptr && (*before)->cells == cells) return *before;
    return std::make_shared<const Tile>(Tile{level, index, version, std::move(cells)});
  }
};

std::vector<TileIndex> ParentsOf(const std::vector<TileIndex>& tiles) {
  std::vector<TileIndex> parents;
  parents.reserve(tiles.size());
  for (const TileIndex tile : tiles) parents.push_back(ParentOf(tile));
  std::sort(parents.begin(), parents.end());
  parents.erase(std::unique(parents.begin(), parents.end()), parents.end());
  return parents;
}

/// Puts tiles in, or takes away where there is none any more. Returns those that differ.
std::vector<TileIndex> Replace(const std::vector<TileIndex>& indices,
                               std::vector<std::shared_ptr<const Tile>> built, TileMap& tiles) {
  std::vector<TileIndex> changed;
  for (std::size_t i = 0; i < indices.size(); ++i) {
    const std::shared_ptr<const Tile>* before = Find(tiles, indices[i]);
    if ((before == nullptr ? nullptr : *before) == built[i]) continue;
    changed.push_back(indices[i]);
    if (built[i] == nullptr) {
      tiles.erase(indices[i]);
    } else {
      tiles[indices[i]] = std::move(built[i]);
    }
  }
  return changed;
}

}  // namespace

CellBelief Coarsen(const std::array<const CellBelief*, 4>& finer, float traversability_free) {
  CellBelief coarse;
  for (const CellBelief* cell : finer) {
    if (!cell->known()) continue;
    coarse.stamp_ns = coarse.known() ? std::max(coarse.stamp_ns, cell->stamp_ns) : cell->stamp_ns;
    coarse.state = kCellKnown;
  }
  if (!coarse.known()) return coarse;
  CoarsenHeight(finer, coarse);
  CoarsenTraversability(finer, traversability_free, coarse);
  CoarsenColor(finer, coarse);
  return coarse;
}

bool UpdatePyramid(std::vector<TileIndex> changed, const GlobalMapOptions& options,
                   const CancelToken& cancel, MapSnapshot& map) {
  std::sort(changed.begin(), changed.end());
  for (int level = 1; level <= kLevelMax && !changed.empty(); ++level) {
    TileMap& tiles = map.coarser[static_cast<std::size_t>(level - 1)];
    const std::vector<TileIndex> parents = ParentsOf(changed);
    const Step step{level,       map.TilesOf(level - 1),     changed, tiles,
                    map.version, options.traversability_free};
    std::vector<std::shared_ptr<const Tile>> built(parents.size());
    ParallelFor(parents.size(), options.compose_threads, [&](std::size_t i) {
      if (!cancel.cancelled()) built[i] = step.Build(parents[i]);
    });
    if (cancel.cancelled()) return false;
    changed = Replace(parents, std::move(built), tiles);
  }
  return true;
}

}  // namespace gem
