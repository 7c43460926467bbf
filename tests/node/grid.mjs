// ENCODINGS.md, "Layers of a grid": gem.v1.Grid to values.
import { Refused, inflated } from './frame.mjs';

const SIDE_CELLS_MAX = 1024;
const WIDTHS = { TYPE_FLOAT32: 4, TYPE_INT16: 2, TYPE_UINT32: 4 };

function bytesOf(layer, field, size) {
  const bytes = layer[field];
  if (layer.zstd) return inflated(bytes, size);
  if (bytes.length !== size) throw new Refused(`${field}: ${bytes.length} bytes, want ${size}`);
  return bytes;
}

/// What is expected of a cell whose neighbours before it are known. at(i): their values.
function predicted(i, columns, valid, at, last) {
  const column = i % columns;
  const has = (j, inRow) => inRow && j >= 0 && valid[j] === 1;
  const [left, lower, corner, right] = [i - 1, i - columns, i - columns - 1, i - columns + 1];
  const hasLeft = has(left, column > 0);
  const hasLower = has(lower, true);
  const hasCorner = has(corner, column > 0);
  if (hasLeft && hasLower) {
    if (!hasCorner) return Math.floor((at(left) + at(lower)) / 2);
    const plane = at(left) + at(lower) - at(corner);
    return [at(left), at(lower), plane].sort((a, b) => a - b)[1];
  }
  if (hasLeft) return at(left);
  if (hasLower) return at(lower);
  if (hasCorner) return at(corner);
  if (has(right, column + 1 < columns)) return at(right);
  return last < 0 ? 0 : at(last);
}

/// Undoes the predictor for one channel: codes[k] of the k-th valid cell, `wrap` into its range.
function unpredicted(codes, columns, valid, wrap) {
  const cells = new Int32Array(valid.length);
  let last = -1;
  let k = 0;
  for (let i = 0; i < valid.length; ++i) {
    if (valid[i] === 0) continue;
    const code = codes[k++];
    const difference = (code >> 1) ^ -(code & 1);
    cells[i] = wrap(predicted(i, columns, valid, (j) => cells[j], last) + difference);
    last = i;
  }
  return cells;
}

function int16Cells(layer, data, columns, valid) {
  if (layer.predictor === 'PREDICTOR_UNSPECIFIED')
    return Int32Array.from(valid, (_, i) => data.readInt16LE(2 * i));
  const count = data.length / 2;
  const codes = Uint16Array.from({ length: count }, (_, k) => data[k] | (data[count + k] << 8));
  return unpredicted(codes, columns, valid, (value) => (value << 16) >> 16);
}

/// [red, green, blue, alpha] a cell.
function colorCells(layer, data, columns, valid) {
  if (layer.predictor === 'PREDICTOR_UNSPECIFIED')
    return Array.from(valid, (_, i) => [...data.subarray(4 * i, 4 * i + 4)]);
  const count = data.length / 4;
  const channels = [0, 1, 2, 3].map((c) =>
    unpredicted(data.subarray(c * count, (c + 1) * count), columns, valid, (value) => value & 255),
  );
  return Array.from(valid, (_, i) => channels.map((channel) => channel[i]));
}

function valuesOf(layer, data, columns, valid) {
  if (layer.layer === 'LAYER_COLOR') return colorCells(layer, data, columns, valid);
  if (layer.type === 'TYPE_FLOAT32') return Array.from(valid, (_, i) => data.readFloatLE(4 * i));
  const cells = int16Cells(layer, data, columns, valid);
  return Array.from(cells, (raw) => Math.fround(raw * layer.scale + layer.offset));
}

function checkLayer(layer) {
  const isColor = layer.layer === 'LAYER_COLOR';
  const types = isColor ? ['TYPE_UINT32'] : ['TYPE_FLOAT32', 'TYPE_INT16'];
  if (!types.includes(layer.type)) throw new Refused(`type ${layer.type}`);
  if (layer.type === 'TYPE_INT16' && !(Number.isFinite(layer.scale) && layer.scale > 0))
    throw new Refused(`scale ${layer.scale}`);
  if (!['PREDICTOR_UNSPECIFIED', 'PREDICTOR_MEDIAN'].includes(layer.predictor))
    throw new Refused(`predictor ${layer.predictor}`);
  if (layer.type === 'TYPE_FLOAT32' && layer.predictor !== 'PREDICTOR_UNSPECIFIED')
    throw new Refused('a predictor of float32');
}

/// Values by index, null where a cell has none.
function decodeLayer(layer, columns, rows) {
  checkLayer(layer);
  const count = columns * rows;
  const bitmap = bytesOf(layer, 'valid_bitmap', Math.ceil(count / 8));
  const valid = Uint8Array.from({ length: count }, (_, i) => (bitmap[i >> 3] >> (i & 7)) & 1);
  const isPredicted = layer.predictor === 'PREDICTOR_MEDIAN';
  const numStored = isPredicted ? valid.reduce((sum, bit) => sum + bit, 0) : count;
  const data = bytesOf(layer, 'data', numStored * WIDTHS[layer.type]);
  const values = valuesOf(layer, data, columns, valid);
  return values.map((value, i) => {
    if (valid[i] === 0) return null;
    if (typeof value === 'number' && !Number.isFinite(value))
      throw new Refused(`cell ${i}: ${value}`);
    return value;
  });
}

/// { LAYER_ELEVATION: [value or null, ...], ... }
export function decodeGrid(grid) {
  for (const side of ['columns', 'rows'])
    if (grid[side] < 1 || grid[side] > SIDE_CELLS_MAX) throw new Refused(`${side} ${grid[side]}`);
  const layers = {};
  for (const layer of grid.layers) {
    if (layer.layer in layers) throw new Refused(`${layer.layer} twice`);
    layers[layer.layer] = decodeLayer(layer, grid.columns, grid.rows);
  }
  return layers;
}
