// Every conversion between metres, cells and tiles. A cell is not a tile, so they are two types.
// Cell (ix, iy) covers [ix * r, (ix + 1) * r) x [iy * r, (iy + 1) * r) of its frame.
#pragma once

#include <cmath>
#include <cstdint>

#include "core/base/host_device.h"

namespace gem {

struct CellIndex {
  std::int32_t x = 0;
  std::int32_t y = 0;
  friend constexpr bool operator==(const CellIndex&, const CellIndex&) = default;
  friend constexpr auto operator<=>(const CellIndex&, const CellIndex&) = default;
};

struct TileIndex {
  std::int32_t x = 0;
  std::int32_t y = 0;
  friend constexpr bool operator==(const TileIndex&, const TileIndex&) = default;
  friend constexpr auto operator<=>(const TileIndex&, const TileIndex&) = default;
  template <typename H>
  friend H AbslHashValue(H h, const TileIndex& t) {
    return H::combine(std::move(h), t.x, t.y);
  }
};

/// log2 of the cells a side of a tile.
inline constexpr int kTileBits = 7;
inline constexpr std::int32_t kTileCells = 1 << kTileBits;

/// Poses farther out than this are refused, so that every cell index fits 32 bits at the smallest
/// cell size.
inline constexpr double kCoordinateMax_m = 1e6;
inline constexpr float kCellSizeMin_m = 0.01f;
inline constexpr float kCellSizeMax_m = 10.0f;

/// Cell that covers the coordinate; rounds down, also below zero. |coordinate_m| <= 2 *
/// kCoordinateMax_m.
inline std::int32_t CellOf(double coordinate_m, double cell_size_m) {
  return static_cast<std::int32_t>(std::floor(coordinate_m / cell_size_m));
}
inline CellIndex CellAt(double x_m, double y_m, double cell_size_m) {
  return {CellOf(x_m, cell_size_m), CellOf(y_m, cell_size_m)};
}
/// Coordinate of the middle of a cell along one axis, metres.
inline double CenterOf(std::int32_t cell, double cell_size_m) { return (cell + 0.5) * cell_size_m; }

// Shifting, not dividing: cell -1 belongs to tile -1, and -1 / 128 would say tile 0.
GEM_HOST_DEVICE constexpr TileIndex TileOf(CellIndex cell) {
  return {cell.x >> kTileBits, cell.y >> kTileBits};
}
/// Lower left cell of a tile.
GEM_HOST_DEVICE constexpr CellIndex OriginOf(TileIndex tile) {
  return {tile.x * kTileCells, tile.y * kTileCells};
}
/// Position of a cell in its tile: row * columns + column from the lower left.
GEM_HOST_DEVICE constexpr std::int32_t IndexInTile(CellIndex cell) {
  return (cell.y & (kTileCells - 1)) * kTileCells + (cell.x & (kTileCells - 1));
}
static_assert(TileOf({-1, 128}) == TileIndex{-1, 1});
static_assert(OriginOf(TileOf({-1, 128})) == CellIndex{-128, 128});
static_assert(IndexInTile({-1, 129}) == 1 * 128 + 127);

/// The map is served in levels: a cell of level n covers 2x2 cells of level n - 1, and so does a
/// tile its tiles. Level 0 has the map's cell size, level kLevelMax 64 times as much.
inline constexpr int kLevelMax = 6;

/// A tile of any level.
struct TileAddress {
  int level = 0;  ///< 0 to kLevelMax
  TileIndex index;
  friend constexpr bool operator==(const TileAddress&, const TileAddress&) = default;
  friend constexpr auto operator<=>(const TileAddress&, const TileAddress&) = default;
  template <typename H>
  friend H AbslHashValue(H h, const TileAddress& t) {
    return H::combine(std::move(h), t.level, t.index);
  }
};

/// Edge of a cell of a level, metres.
GEM_HOST_DEVICE constexpr double CellSizeAt(int level, double cell_size_m) {
  return cell_size_m * (1 << level);
}
/// Cell of a level that covers a cell of level 0. Shifting rounds down, also below zero.
GEM_HOST_DEVICE constexpr CellIndex CellAtLevel(int level, CellIndex cell) {
  return {cell.x >> level, cell.y >> level};
}
/// Tile of a level that covers a tile of level 0.
GEM_HOST_DEVICE constexpr TileIndex TileAtLevel(int level, TileIndex tile) {
  return {tile.x >> level, tile.y >> level};
}
/// Tile of the next coarser level that covers a tile.
GEM_HOST_DEVICE constexpr TileIndex ParentOf(TileIndex tile) { return TileAtLevel(1, tile); }
/// Lower left one of the four tiles that a tile of the next coarser level covers.
GEM_HOST_DEVICE constexpr TileIndex FirstChildOf(TileIndex parent) {
  return {parent.x * 2, parent.y * 2};
}
static_assert(CellAtLevel(kLevelMax, {-1, 64}) == CellIndex{-1, 1});
static_assert(CellAtLevel(1, {-3, -2}) == CellIndex{-2, -1});
static_assert(ParentOf({-1, 3}) == TileIndex{-1, 1});
static_assert(FirstChildOf(ParentOf({-1, 3})) == TileIndex{-2, 2});
static_assert(TileAtLevel(3, TileOf({-1025, 1023})) == TileIndex{-2, 0});
static_assert(TileOf(CellAtLevel(3, {-1025, 1023})) == TileAtLevel(3, TileOf({-1025, 1023})));

/// Both indices in 64 bits, y above x: the key of hash grids. Order of keys is by row, then column.
GEM_HOST_DEVICE constexpr std::uint64_t PackedKey(CellIndex cell) {
  constexpr std::uint32_t kSignBit = 0x80000000u;
  return (static_cast<std::uint64_t>(static_cast<std::uint32_t>(cell.y) ^ kSignBit) << 32) |
         (static_cast<std::uint32_t>(cell.x) ^ kSignBit);
}
static_assert(PackedKey({5, -1}) < PackedKey({-5, 0}));

/// a modulo b with the sign of b. b > 0.
GEM_HOST_DEVICE constexpr std::int32_t FloorMod(std::int32_t a, std::int32_t b) {
  const std::int32_t remainder = a % b;
  return remainder < 0 ? remainder + b : remainder;
}
static_assert(FloorMod(-1, 40) == 39);

/// Half-open rectangle of tiles of one level [min, max).
struct TileRange {
  TileIndex min;
  TileIndex max;
  constexpr bool Contains(TileIndex t) const {
    return t.x >= min.x && t.x < max.x && t.y >= min.y && t.y < max.y;
  }
  /// 0 if it is empty.
  constexpr std::uint64_t num_tiles() const {
    if (min.x >= max.x || min.y >= max.y) return 0;
    return static_cast<std::uint64_t>(std::int64_t{max.x} - min.x) *
           static_cast<std::uint64_t>(std::int64_t{max.y} - min.y);
  }
  friend constexpr bool operator==(const TileRange&, const TileRange&) = default;
};

/// Half-open rectangle of cells [min, max).
struct CellRect {
  CellIndex min;
  CellIndex max;
  constexpr bool empty() const { return min.x >= max.x || min.y >= max.y; }
  constexpr bool Contains(CellIndex c) const {
    return c.x >= min.x && c.x < max.x && c.y >= min.y && c.y < max.y;
  }
  friend constexpr bool operator==(const CellRect&, const CellRect&) = default;
};

}  // namespace gem
