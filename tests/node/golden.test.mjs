// The decoder that was written from ENCODINGS.md finds in the golden vectors what is in them.
import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import path from 'node:path';
import { test } from 'node:test';

import { Refused, inflated, stored } from './frame.mjs';
import { decodeGrid } from './grid.mjs';
import { cellAt, cellAtLevel, indexInTile, middleOf, tileOf } from './place.mjs';
import { ROOT, message } from './protocol.mjs';
import { decodeScan, encodeDeltas, packedPoints } from './scan.mjs';

function vectors(name) {
  const { cases } = JSON.parse(readFileSync(path.join(ROOT, `tests/proto/golden/${name}.json`)));
  assert.ok(cases.length > 0);
  return cases;
}

/// Numbers of the vectors are the shortest that are nearest to a float32.
const float32 = (value) => (typeof value === 'number' ? Math.fround(value) : value);

for (const vector of vectors('grids'))
  test(`grid ${vector.name}: ${vector.shows}`, () => {
    const grid = message('gem.v1.Grid', vector.grid);
    const layers = decodeGrid(grid);
    grid.layers.forEach((layer, i) => {
      const want = vector.layers[i];
      for (const [bytes, hex] of [
        [layer.valid_bitmap, want.valid_bitmap_hex],
        [layer.data, want.data_hex ?? ''],
      ])
        assert.equal((layer.zstd ? inflated(bytes, hex.length / 2) : bytes).toString('hex'), hex);
      assert.deepEqual(layers[layer.layer], want.values.map(float32));
    });
  });

for (const vector of vectors('scans'))
  test(`scan ${vector.name}: ${vector.shows}`, () => {
    const scan = message('gem.v1.Scan', vector.scan);
    const decoded = decodeScan(scan);
    if (scan.depth_image) {
      assert.equal(decoded.depth.toString('hex'), vector.depth_hex);
      assert.equal(decoded.rgb.toString('hex'), vector.rgb_hex ?? '');
    } else {
      assert.equal(packedPoints(scan).toString('hex'), vector.points_hex ?? '');
    }
    const want = vector.points ?? [];
    assert.equal(decoded.points.length, want.length);
    decoded.points.forEach((point, i) =>
      point.forEach((value, axis) => {
        if (!scan.depth_image) assert.equal(value, float32(want[i][axis]));
        else assert.ok(Math.abs(value - want[i][axis]) <= 1e-6 * Math.max(1, Math.abs(value)));
      }),
    );
    if (vector.colors) assert.deepEqual(decoded.colors, vector.colors);
    assert.deepEqual(decoded.time_offsets_s, (vector.time_offsets_s ?? []).map(float32));
    if (scan.compression === 'SCAN_COMPRESSION_DELTA_ZSTD') {
      const packed = Buffer.from(vector.points_hex ?? '', 'hex');
      const planes = encodeDeltas(packed, scan.fields, scan.point_stride);
      assert.equal(planes.toString('hex'), vector.frame_hex ?? '');
    }
  });

for (const vector of vectors('refusals'))
  test(`refused: ${vector.name}`, () => {
    const decode = () =>
      vector.grid
        ? decodeGrid(message('gem.v1.Grid', vector.grid))
        : decodeScan(message('gem.v1.Scan', vector.scan));
    assert.throws(decode, Refused);
  });

test('places: metres, cells, tiles and levels', () => {
  for (const place of vectors('places')) {
    const [x, y] = [place.x_m, place.y_m].map((metres) => cellAt(metres, place.cell_size_m));
    assert.deepEqual([x, y], [place.cell_x, place.cell_y]);
    const cell = [x, y].map((index) => cellAtLevel(index, place.level));
    assert.deepEqual(cell, [place.level_cell_x, place.level_cell_y]);
    assert.deepEqual(cell.map(tileOf), [place.tile.x, place.tile.y]);
    assert.equal(indexInTile(...cell), place.index);
    const middle = cell.map((index) => middleOf(index, place.cell_size_m, place.level));
    assert.deepEqual(middle, [place.middle_x_m, place.middle_y_m]);
  }
});

test('frames of stored blocks are frames', () => {
  for (const size of [0, 1, 300, 128 * 1024, 300_000]) {
    const bytes = Buffer.alloc(size, 'terrain');
    assert.ok(inflated(stored(bytes), size).equals(bytes));
  }
});
