#include "core/grid/cell_index.h"
#include "gem/v1/types.pb.h"
#include "tests/proto/golden/golden_cases.h"

namespace gem::golden {

Places MakePlaces() {
  struct Place {
    double x_m, y_m, cell_size_m;
  };
  Places places;
  for (const Place& place : {Place{0, 0, 0.2}, Place{-0.01, 25.59, 0.2}, Place{25.65, -25.65, 0.2},
                             Place{-1000.3, 731.7, 0.05}, Place{5e5, -5e5, 0.25}})
    for (const int level : {0, 1, 3, kLevelMax}) {
      PlaceCase& result = *places.add_cases();
      result.set_x_m(place.x_m);
      result.set_y_m(place.y_m);
      result.set_cell_size_m(place.cell_size_m);
      const CellIndex cell = CellAt(place.x_m, place.y_m, place.cell_size_m);
      result.set_cell_x(cell.x);
      result.set_cell_y(cell.y);
      result.set_level(level);
      const CellIndex level_cell = CellAtLevel(level, cell);
      result.set_level_cell_x(level_cell.x);
      result.set_level_cell_y(level_cell.y);
      const TileIndex tile = TileOf(level_cell);
      result.mutable_tile()->set_level(static_cast<std::uint32_t>(level));
      result.mutable_tile()->set_x(tile.x);
      result.mutable_tile()->set_y(tile.y);
      result.set_index(static_cast<std::uint32_t>(IndexInTile(level_cell)));
      const double cell_size_m = CellSizeAt(level, place.cell_size_m);
      result.set_middle_x_m(CenterOf(level_cell.x, cell_size_m));
      result.set_middle_y_m(CenterOf(level_cell.y, cell_size_m));
    }
  return places;
}

}  // namespace gem::golden
