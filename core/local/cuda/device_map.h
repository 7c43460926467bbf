// The local map as it lies in device memory, and what one scan needs beside it: plain pointers and
// numbers that kernels take by value. Owned by cuda_mapper.cc; nothing here allocates.
#pragma once

#include <cstdint>

#include "core/base/host_device.h"
#include "core/grid/cell_belief.h"
#include "core/local/clear.h"
#include "core/local/fuse.h"
#include "core/sensor/scan_point.h"

namespace gem::cuda {

/// Layers by slot of the ring. A value without its state bit is zero, and a known cell has a
/// variance above zero.
struct DeviceLayers {
  std::uint8_t* state;
  float* elevation_m;
  float* variance_m2;
  float* slope_rad;
  float* roughness_m;
  float* traversability;
  Rgba* rgba;
  std::int64_t* observed_ns;
};

/// A cell of the window from the lower left.
struct Place {
  std::int32_t column;
  std::int32_t row;
};

/// Where the cells of the window are stored: RingWindow in five numbers.
struct DeviceWindow {
  CellIndex origin;
  std::int32_t side_cells;
  std::int32_t start_column, start_row;  ///< of the ring, where the window begins

  GEM_HOST_DEVICE std::uint32_t num_cells() const {
    return static_cast<std::uint32_t>(side_cells * side_cells);
  }
  GEM_HOST_DEVICE bool Contains(Place place) const {
    return place.column >= 0 && place.column < side_cells && place.row >= 0 &&
           place.row < side_cells;
  }
  GEM_HOST_DEVICE Place PlaceOf(std::uint32_t index) const {
    const auto side = static_cast<std::uint32_t>(side_cells);
    return {static_cast<std::int32_t>(index % side), static_cast<std::int32_t>(index / side)};
  }
  GEM_HOST_DEVICE std::uint32_t IndexOf(Place place) const {
    return static_cast<std::uint32_t>(place.row * side_cells + place.column);
  }
  GEM_HOST_DEVICE std::uint32_t SlotOf(Place place) const {
    const std::int32_t column = start_column + place.column;
    const std::int32_t row = start_row + place.row;
    return static_cast<std::uint32_t>((row < side_cells ? row : row - side_cells) * side_cells +
                                      (column < side_cells ? column : column - side_cells));
  }
};

inline DeviceWindow WindowAt(CellIndex origin, std::int32_t side_cells) {
  return {origin, side_cells, FloorMod(origin.x, side_cells), FloorMod(origin.y, side_cells)};
}

/// The places of a window that the next one lacks, in the order of rows: whole rows, the ends of
/// rows that stay, whole rows.
struct LeavingPlaces {
  std::int32_t side_cells;
  std::int32_t row_begin, row_end;        ///< rows that stay
  std::int32_t column_begin, column_end;  ///< columns that stay in those rows

  GEM_HOST_DEVICE std::int32_t width() const { return side_cells - (column_end - column_begin); }
  GEM_HOST_DEVICE std::uint32_t count() const {
    const std::int32_t rows = row_end - row_begin;
    return static_cast<std::uint32_t>((side_cells - rows) * side_cells + rows * width());
  }
  GEM_HOST_DEVICE Place At(std::uint32_t number) const {
    auto i = static_cast<std::int32_t>(number);
    if (i < row_begin * side_cells) return {i % side_cells, i / side_cells};
    i -= row_begin * side_cells;
    if (i < (row_end - row_begin) * width()) {
      const std::int32_t column = i % width();
      const bool before = column < column_begin;
      return {before ? column : column - column_begin + column_end, row_begin + i / width()};
    }
    i -= (row_end - row_begin) * width();
    return {i % side_cells, row_end + i / side_cells};
  }
};

/// What leaves a window of side_cells when it moves by (shift_x, shift_y) cells.
LeavingPlaces LeavingAfter(std::int32_t shift_x, std::int32_t shift_y, std::int32_t side_cells);

/// The lowest slopes of rays by range bin, then azimuth bin, as ordered integers (ordered_float.h).
struct DeviceRays {
  RayBins bins;
  std::int32_t limit;  ///< rays that end in later range bins are kept here
  std::uint32_t* slopes;
};

/// The points of one scan over one cell, in the sorted hits.
struct CellRun {
  std::uint32_t begin;
  std::uint32_t end;
};

/// What kernels count, one scan.
enum Counter : std::uint32_t {
  kFates = 0,  ///< six counters, by PointFate
  kFused = 6,
  kGated,
  kFusedAgain,  ///< points of cleared cells; they were counted as gated before
  kRestarted,
  kInflated,
  kCleared,
  kEvicted,
  kNumCounters,
};

/// Of the scan in hand.
struct DeviceScan {
  const ScanPoint* points;
  std::uint64_t num_points;  ///< fits 32 bits; wide, so that no gap of the struct holds old bytes
  std::uint32_t* keys;       ///< a point's window index, or gpu::kNoKey if it is in no cell
  std::uint32_t* positions;  ///< after the sort: the point's place in the scan
  const std::uint32_t* num_hits;  ///< after the sort: points that are in a cell
  Hit* hits;                      ///< by point
  Hit* sorted_hits;               ///< by cell, within a cell in point order
  CellRun* runs;                  ///< by window index; begin == end without points
  std::uint8_t* changed;  ///< by window index: the elevation is new since the last annotation
  std::uint32_t* counters;
};

}  // namespace gem::cuda
