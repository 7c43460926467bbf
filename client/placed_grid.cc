#include "client/placed_grid.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "absl/strings/str_cat.h"
#include "core/base/check.h"
#include "core/base/status_macros.h"

namespace gem::client {
namespace {

/// Calls `visit` with each cell of the tile that has an elevation.
template <typename Visitor>
void VisitKnown(const MapTile& tile, Visitor visit) {
  if (!tile.grid) return;
  const GridLayer* elevation = tile.grid->Find(Layer::kElevation);
  GEM_CHECK(elevation != nullptr);
  const CellIndex origin = OriginOf(tile.index);
  for (std::int32_t row = 0; row < kTileCells; ++row)
    for (std::int32_t column = 0; column < kTileCells; ++column)
      if (elevation->valid[static_cast<std::size_t>(row) * kTileCells + column] != 0)
        visit(CellIndex{origin.x + column, origin.y + row});
}

/// The smallest rectangle of all cells with an elevation.
CellRect KnownCells(const TileSet& set) {
  constexpr std::int32_t kLow = std::numeric_limits<std::int32_t>::min();
  constexpr std::int32_t kHigh = std::numeric_limits<std::int32_t>::max();
  CellRect rect{{kHigh, kHigh}, {kLow, kLow}};
  for (const MapTile& tile : set.tiles) {
    VisitKnown(tile, [&rect](CellIndex cell) {
      rect.min = {std::min(rect.min.x, cell.x), std::min(rect.min.y, cell.y)};
      rect.max = {std::max(rect.max.x, cell.x + 1), std::max(rect.max.y, cell.y + 1)};
    });
  }
  return rect;
}

void CopyLayer(const MapTile& tile, const GridLayer& from, const CellRect& rect, GridLayer& to) {
  const std::int64_t columns = std::int64_t{rect.max.x} - rect.min.x;
  const CellIndex origin = OriginOf(tile.index);
  for (std::int32_t row = 0; row < kTileCells; ++row) {
    for (std::int32_t column = 0; column < kTileCells; ++column) {
      const CellIndex cell{origin.x + column, origin.y + row};
      const std::size_t source = static_cast<std::size_t>(row) * kTileCells + column;
      if (from.valid[source] == 0 || !rect.Contains(cell)) continue;
      const auto target = static_cast<std::size_t>((std::int64_t{cell.y} - rect.min.y) * columns +
                                                   (std::int64_t{cell.x} - rect.min.x));
      to.valid[target] = 1;
      if (from.layer == Layer::kColor) {
        to.colors[target] = from.colors[source];
      } else {
        to.values[target] = from.values[source];
      }
    }
  }
}

}  // namespace

absl::StatusOr<CellRect> CellsOf(const Region& region, double cell_size_m) {
  for (const double bound : {region.x_m_min, region.y_m_min, region.x_m_max, region.y_m_max})
    if (!(std::abs(bound) <= kCoordinateMax_m))
      return absl::OutOfRangeError(absl::StrCat("region holds ", bound, ", want at most ",
                                                kCoordinateMax_m, " m in magnitude"));
  // Cell i is in if min <= (i + 0.5) * size < max.
  const auto first = [cell_size_m](double bound_m) {
    return static_cast<std::int32_t>(std::ceil(bound_m / cell_size_m - 0.5));
  };
  const CellRect rect{{first(region.x_m_min), first(region.y_m_min)},
                      {first(region.x_m_max), first(region.y_m_max)}};
  if (rect.empty())
    return absl::OutOfRangeError(absl::StrCat(
        "region is ", region.x_m_min, ",", region.y_m_min, ",", region.x_m_max, ",", region.y_m_max,
        ", want X0 < X1 and Y0 < Y1 with at least one cell of ", cell_size_m, " m between"));
  return rect;
}

absl::StatusOr<PlacedGrid> Join(const TiledMap& map, const std::optional<Region>& region,
                                const std::vector<Layer>& layers) {
  CellRect rect = KnownCells(map.tiles);
  if (rect.empty()) return absl::NotFoundError("no cell is known");
  if (region) {
    GEM_ASSIGN_OR_RETURN(const CellRect wanted, CellsOf(*region, map.matrix.cell_size_m));
    if (wanted.min.x >= rect.max.x || wanted.max.x <= rect.min.x || wanted.min.y >= rect.max.y ||
        wanted.max.y <= rect.min.y)
      return absl::NotFoundError("no cell of the region is known");
    rect = wanted;
  }
  const std::int64_t columns = std::int64_t{rect.max.x} - rect.min.x;
  const std::int64_t rows = std::int64_t{rect.max.y} - rect.min.y;
  if (columns * rows > kPlacedCellsMax)
    return absl::ResourceExhaustedError(absl::StrCat(columns, " x ", rows, " cells, want at most ",
                                                     kPlacedCellsMax, ": choose a region"));
  PlacedGrid placed{{static_cast<std::int32_t>(columns),
                     static_cast<std::int32_t>(rows),
                     map.matrix.cell_size_m,
                     {}},
                    rect.min,
                    map.matrix.traversability_free};
  for (const Layer layer : layers) {
    GridLayer joined{layer, {}, {}, {}};
    joined.valid.resize(placed.grid.num_cells());
    if (layer == Layer::kColor) {
      joined.colors.resize(placed.grid.num_cells());
    } else {
      joined.values.resize(placed.grid.num_cells());
    }
    for (const MapTile& tile : map.tiles.tiles)
      if (tile.grid) CopyLayer(tile, *tile.grid->Find(layer), rect, joined);
    placed.grid.layers.push_back(std::move(joined));
  }
  return placed;
}

}  // namespace gem::client
