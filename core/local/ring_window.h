// Where the cells of a moving window are stored: a cell's slot depends on the cell alone, so
// nothing is copied when the window moves; what enters takes the slots of what left.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/grid/cell_index.h"

namespace gem {

/// A cell of the window from the lower left; fits, as a side has at most 1024 cells.
struct Place {
  std::int16_t column = 0;
  std::int16_t row = 0;
};

/// A square window and its ring buffer. Window coordinates (column, row) count from the lower left;
/// slots are where a layer keeps the cell.
class RingWindow {
 public:
  explicit RingWindow(std::int32_t side_cells)
      : side_cells_(side_cells),
        inverse_of_side_(1.0f / static_cast<float>(side_cells)),
        slot_of_column_(static_cast<std::size_t>(side_cells)),
        slot_of_row_(static_cast<std::size_t>(side_cells)) {
    MoveTo({0, 0});
  }

  void MoveTo(CellIndex origin) {
    origin_ = origin;
    for (std::int32_t i = 0; i < side_cells_; ++i) {
      slot_of_column_[static_cast<std::size_t>(i)] =
          static_cast<std::uint32_t>(FloorMod(origin.x + i, side_cells_));
      slot_of_row_[static_cast<std::size_t>(i)] =
          static_cast<std::uint32_t>(FloorMod(origin.y + i, side_cells_) * side_cells_);
    }
  }

  CellIndex origin() const { return origin_; }
  std::int32_t side_cells() const { return side_cells_; }
  std::size_t num_cells() const {
    return static_cast<std::size_t>(side_cells_) * static_cast<std::size_t>(side_cells_);
  }
  CellRect rect() const { return {origin_, {origin_.x + side_cells_, origin_.y + side_cells_}}; }

  /// Window index: row * side_cells + column.
  std::uint32_t IndexOf(Place place) const {
    return static_cast<std::uint32_t>(place.row * side_cells_ + place.column);
  }
  Place PlaceOf(std::uint32_t index) const {
    // Exact, as an index is below 2^20: its middle is farther from a whole row than floats err. A
    // division would take longer than all the rest.
    const auto row =
        static_cast<std::uint32_t>((static_cast<float>(index) + 0.5f) * inverse_of_side_);
    const std::uint32_t column = index - row * static_cast<std::uint32_t>(side_cells_);
    return {static_cast<std::int16_t>(column), static_cast<std::int16_t>(row)};
  }

  std::uint32_t SlotOf(Place place) const { return SlotAt(place.column, place.row); }
  std::uint32_t SlotAt(std::int32_t column, std::int32_t row) const {
    return slot_of_row_[static_cast<std::size_t>(row)] +
           slot_of_column_[static_cast<std::size_t>(column)];
  }
  std::uint32_t SlotOf(CellIndex cell) const {
    return SlotAt(cell.x - origin_.x, cell.y - origin_.y);
  }

 private:
  // Constant after construction.
  const std::int32_t side_cells_;
  const float inverse_of_side_;

  CellIndex origin_;
  std::vector<std::uint32_t> slot_of_column_;
  std::vector<std::uint32_t> slot_of_row_;  // slot of column 0
};

/// Lower left cell of the window that has the base in its middle.
inline CellIndex WindowOriginAt(double base_x_m, double base_y_m, double cell_size_m,
                                std::int32_t side_cells) {
  const CellIndex base = CellAt(base_x_m, base_y_m, cell_size_m);
  return {base.x - side_cells / 2, base.y - side_cells / 2};
}

}  // namespace gem
