// What is believed of one cell, wherever it is on its way: local map, evicted, submap, tile.
#pragma once

#include <cstdint>

#include "core/grid/cell_index.h"

namespace gem {

/// Colours are packed with red in the lowest byte; alpha is 0 (no colour) or 255.
using Rgba = std::uint32_t;

/// Which values of a cell mean something. Unknown is a state of its own: no value stands for it.
enum CellState : std::uint8_t {
  kCellKnown = 1,      ///< elevation, variance and stamp are valid
  kCellAnnotated = 2,  ///< traversability (and slope and roughness, where kept) are valid
  kCellColored = 4,    ///< the colour is valid
};

/// Values whose state bit is not set are zero.
struct CellBelief {
  float elevation_m = 0;  ///< over z = 0 of the frame that the holder names
  float variance_m2 = 0;
  float traversability = 0;  ///< 0 obstacle .. 1 flat
  Rgba rgba = 0;
  std::int64_t stamp_ns = 0;  ///< last observation
  std::uint8_t state = 0;     ///< CellState bits

  bool known() const { return (state & kCellKnown) != 0; }
  bool annotated() const { return (state & kCellAnnotated) != 0; }
  bool colored() const { return (state & kCellColored) != 0; }
  friend bool operator==(const CellBelief&, const CellBelief&) = default;
};

/// A cell that left the local map, on its way into a submap. Frame O.
struct EvictedCell {
  CellIndex cell;
  CellBelief belief;
};

}  // namespace gem
