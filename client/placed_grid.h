// A rectangle of cells that knows where it lies in its frame: what exports and pictures are made
// of. Joins tiles into one such rectangle.
#pragma once

#include <cstdint>
#include <optional>

#include "absl/status/statusor.h"
#include "client/map_client.h"
#include "client/map_types.h"
#include "core/grid/cell_index.h"
#include "core/grid/layered_grid.h"

namespace gem::client {

/// Cell (column, row) is the cell (origin.x + column, origin.y + row) of G or O.
struct PlacedGrid {
  LayeredGrid grid;
  CellIndex origin;
  float traversability_free = 0;  ///< cells above this are free
};

/// Largest rectangle that is joined: 11.5 x 11.5 km at 1 m.
inline constexpr std::int64_t kPlacedCellsMax = std::int64_t{1} << 27;

/// Cells whose centres lie in the region. OUT_OF_RANGE if the region is empty or beyond the world.
absl::StatusOr<CellRect> CellsOf(const Region& region, double cell_size_m);

/// The tiles as one rectangle: that of the region, or the smallest that holds every cell with an
/// elevation. All tiles must have the given layers, elevation among them. NOT_FOUND if no cell is
/// known, RESOURCE_EXHAUSTED if the rectangle has more than kPlacedCellsMax cells.
absl::StatusOr<PlacedGrid> Join(const TiledMap& map, const std::optional<Region>& region,
                                const std::vector<Layer>& layers);

}  // namespace gem::client
