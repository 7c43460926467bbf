// ENCODINGS.md, "Where a cell is".
const TILE_CELLS = 128;

export const cellAt = (metres, cellSize) => Math.floor(metres / cellSize);
export const cellAtLevel = (cell, level) => cell >> level;
export const tileOf = (cell) => cell >> 7;
export const indexInTile = (x, y) => (y & 127) * TILE_CELLS + (x & 127);
export const middleOf = (cell, cellSize, level) => (cell + 0.5) * cellSize * 2 ** level;
/// [x, y] of the cell at an index of a tile of the same level.
export const cellOfTile = (tile, index) => [
  TILE_CELLS * tile.x + (index % TILE_CELLS),
  TILE_CELLS * tile.y + Math.floor(index / TILE_CELLS),
];
