// Against a server: a robot streams, planners read. Whatever is said here holds for any client that
// keeps to the .proto files and ENCODINGS.md.
import assert from 'node:assert/strict';
import { after, before, test } from 'node:test';

import { decodeGrid } from './grid.mjs';
import { cellAt, cellOfTile, indexInTile, middleOf, tileOf } from './place.mjs';
import { Answers, connect, errorDetails, status } from './protocol.mjs';
import { Robot, groundAt } from './robot.mjs';
import { startServer } from './server.mjs';
import { WatchedTiles, keyOf } from './watch.mjs';

const CELL_M = 0.25;
const MIB = 1024 * 1024;
const TILE_LAYERS = ['LAYER_ELEVATION', 'LAYER_VARIANCE', 'LAYER_TRAVERSABILITY', 'LAYER_AGE'];

let server, ingest, maps, terrain, tiles;

before(async () => {
  server = await startServer();
  [ingest, maps, terrain, tiles] = [
    'IngestService',
    'MapService',
    'TerrainService',
    'TileService',
  ].map((service) => connect(service, server.address));
});

after(async () => {
  for (const stub of [ingest, maps, terrain, tiles]) stub.close();
  assert.equal(await server.stop(), 0);
});

const revisionOf = (version) => Number(version.revision);

/// Drives a robot from x = 0 to 4 m through a session of its own; the plain begins at `start`.
async function drive(session, start, options = {}) {
  const robot = await Robot.open(ingest, {
    map: 'plain',
    robot: session,
    session,
    map_from_odom: { x: start, y: 0, z: 0, qx: 0, qy: 0, qz: 0, qw: 1 },
    local_map: { side_m: 12 },
  });
  const scanBytes = [];
  for (let i = 0; i <= 8; ++i) scanBytes.push(await robot.send(i / 2, { compact: i % 2 === 1 }));
  await options.beforeClose?.(robot);
  const closed = await robot.close();
  return { closed, robot, scanBytes };
}

async function rejected(promise) {
  try {
    await promise;
  } catch (error) {
    return error;
  }
  return assert.fail('it was not refused');
}

test('a map is made once, however often it is asked for', async () => {
  const request = { map: 'plain', setup: { cell_size_m: CELL_M }, request_id: 'first' };
  const { map } = await maps.CreateMap(request);
  assert.equal(map.id, 'plain');
  assert.deepEqual((await maps.CreateMap(request)).map.version, map.version);
  const error = await rejected(maps.CreateMap({ ...request, request_id: 'second' }));
  assert.equal(error.code, status.ALREADY_EXISTS);
});

test('a robot streams plain and compact scans', async () => {
  const { closed, robot, scanBytes } = await drive('ada', 0);
  assert.equal(robot.opened.cell_size_m, CELL_M);
  assert.equal(closed.num_scans_fused, '9');
  assert.equal(closed.num_scans_refused, '0');
  assert.deepEqual(robot.problems, []);
  assert.ok(scanBytes[1] < 0.6 * scanBytes[0], 'stored blocks: half the bytes of float32');
});

test('a refused scan is named, and the stream goes on', async () => {
  const { closed, robot } = await drive('bob', 200, {
    async beforeClose(robot) {
      await robot.send(4.5, {
        compact: false,
        points: [
          [1, 2, -1],
          [3, NaN, 4],
        ],
      });
      await robot.send(5, { compact: true });
      await robot.allFused();
    },
  });
  assert.equal(closed.num_scans_fused, '10');
  assert.equal(closed.num_scans_refused, '1');
  assert.equal(robot.problems.length, 1);
  assert.equal(robot.problems[0].seq, '10');
  assert.equal(robot.problems[0].reason, 'PROBLEM_REASON_MALFORMED');
  assert.match(robot.problems[0].message, /points\[1\]\.y is nan/);
});

async function matrixOf(level = 0) {
  return tiles.GetTileMatrix({ map: 'plain', level });
}

async function batch(keys, options = {}) {
  return tiles.BatchGetTiles({ map: 'plain', tiles: keys, layers: TILE_LAYERS, ...options });
}

test('raw and compact tiles have the same cells', async () => {
  const matrix = await matrixOf();
  assert.equal(matrix.cell_size_m, CELL_M);
  assert.equal(matrix.tile_cells, 128);
  const raw = await batch(matrix.tiles, { encoding: 'CELL_ENCODING_RAW' });
  const compact = await batch(matrix.tiles, { encoding: 'CELL_ENCODING_COMPACT' });
  assert.deepEqual(raw.version, compact.version);
  // In steps: which way ENCODINGS.md rounds, and what float32 adds.
  const errors = {
    LAYER_ELEVATION: [-0.501, 0.501],
    LAYER_VARIANCE: [-0.001, 1.001],
    LAYER_TRAVERSABILITY: [-1.001, 0.001],
    LAYER_AGE: [-0.501, 0.501],
  };
  let numCells = 0;
  raw.tiles.forEach((tile, t) => {
    const want = decodeGrid(tile.grid);
    const got = decodeGrid(compact.tiles[t].grid);
    assert.deepEqual(Object.keys(got), TILE_LAYERS);
    for (const layer of TILE_LAYERS) {
      const { scale } = compact.tiles[t].grid.layers.find((l) => l.layer === layer);
      want[layer].forEach((value, i) => {
        assert.equal(got[layer][i] === null, value === null, `${layer} of cell ${i}`);
        if (value === null) return;
        ++numCells;
        const error = (got[layer][i] - value) / scale;
        const [low, high] = errors[layer];
        assert.ok(
          error >= low && error <= high,
          `${layer} of cell ${i}: ${value} is ${got[layer][i]}`,
        );
      });
    }
  });
  assert.ok(numCells > 4000);
});

test('heights are where the robot saw them', async () => {
  const { tiles: all } = await batch((await matrixOf()).tiles);
  let numCells = 0;
  for (const { key, grid } of all) {
    decodeGrid(grid).LAYER_ELEVATION.forEach((height, i) => {
      if (height === null) return;
      const [x, y] = cellOfTile(key, i).map((cell) => middleOf(cell, CELL_M, 0));
      if (x > 5 || Math.abs(y) > 3) return; // before the wall, of the first robot
      ++numCells;
      assert.ok(Math.abs(height - groundAt(x)) < 0.05, `(${x}, ${y}) is ${height}`);
    });
  }
  assert.ok(numCells > 500);
});

test('a tile that is held is not sent again', async () => {
  const { tiles: keys } = await matrixOf();
  const held = await batch(keys);
  const etags = held.tiles.map((tile) => tile.etag);
  const again = await batch(keys, { if_none_match: etags });
  for (const tile of again.tiles) assert.equal(tile.content, 'not_modified');
  etags[0] = '0';
  const one = await batch(keys, { if_none_match: etags });
  assert.equal(one.tiles[0].content, 'grid');
  const nowhere = await batch([{ level: 0, x: 1000, y: -1000 }]);
  assert.equal(nowhere.tiles[0].content, 'absent');
});

for (const level of [0, 2])
  test(`all tiles of level ${level} come as a stream, too`, async () => {
    const matrix = await matrixOf(level);
    const stream = tiles.StreamTiles({
      map: 'plain',
      level,
      layers: TILE_LAYERS,
      nearest_to: { x: 200, y: 0 },
    });
    const parts = await new Answers(stream).all();
    const streamed = new WatchedTiles();
    const order = parts.flatMap((part) => part.tiles.map((tile) => tile.key));
    for (const part of parts) {
      streamed.take(part);
      const bytes = part.tiles
        .flatMap((tile) => tile.grid.layers)
        .reduce((sum, l) => sum + l.data.length, 0);
      assert.ok(bytes < MIB);
    }
    assert.deepEqual([...streamed.tiles.keys()].sort(), matrix.tiles.map(keyOf).sort());
    const got = await batch(matrix.tiles);
    for (const tile of got.tiles) assert.equal(streamed.tiles.get(keyOf(tile.key)).etag, tile.etag);
    const side = 128 * CELL_M * 2 ** level;
    const distances = order.map(({ x }) => Math.abs((x + 0.5) * side - 200));
    if (level === 0) assert.ok(distances[0] < distances.at(-1), 'nearest first');
  });

/// Reads changes until one leads to `revision` or beyond.
async function follow(answers, watched, revision) {
  for (;;) {
    const part = await answers.next();
    if (watched.take(part) && revisionOf(watched.version) >= revision) return part;
  }
}

async function assertHoldsMap(watched) {
  const { tiles: keys } = await matrixOf();
  assert.deepEqual([...watched.tiles.keys()].sort(), keys.map(keyOf).sort());
  const now = await batch(keys, { at: watched.version });
  for (const tile of now.tiles) {
    const held = watched.tiles.get(keyOf(tile.key));
    assert.equal(held.etag, tile.etag);
    assert.deepEqual(decodeGrid(held.grid), decodeGrid(tile.grid));
  }
}

test('a watched map follows the robots, goes on after a break, forgets what is retracted', async () => {
  const request = { map: 'plain', layers: TILE_LAYERS };
  const watched = new WatchedTiles();
  const first = new Answers(tiles.WatchTiles(request));
  const begin = await first.next();
  assert.equal(begin.reset, true);
  assert.equal(begin.base, null);
  watched.take(begin);
  if (watched.version === null) await follow(first, watched, 0);
  await assertHoldsMap(watched);

  const second = await drive('cyd', 400);
  await follow(first, watched, revisionOf(second.closed.version));
  await assertHoldsMap(watched);
  first.cancel();

  // While nobody watches, the map grows.
  const held = watched.version;
  const third = await drive('dan', 600);
  const resumed = new Answers(tiles.WatchTiles({ ...request, resume_from: held }));
  const change = await resumed.next();
  assert.equal(change.reset, false);
  assert.deepEqual(change.base, held);
  watched.take(change);
  if (revisionOf(watched.version) < revisionOf(third.closed.version))
    await follow(resumed, watched, revisionOf(third.closed.version));
  await assertHoldsMap(watched);

  const numTiles = watched.tiles.size;
  const retracted = await maps.RetractSession({
    map: 'plain',
    session: 'dan',
    request_id: 'wrong',
  });
  await follow(resumed, watched, revisionOf(retracted.version));
  assert.ok(watched.tiles.size < numTiles, 'its tiles came as absent');
  await assertHoldsMap(watched);
  resumed.cancel();
});

test("a robot's local map is watched while it drives", async () => {
  await drive('eve', 800, {
    async beforeClose(robot) {
      await robot.allFused();
      const answers = new Answers(
        tiles.WatchLocalMap({
          robot: 'eve',
          layers: [...TILE_LAYERS, 'LAYER_SLOPE', 'LAYER_ROUGHNESS'],
        }),
      );
      let { local_map: map } = await answers.next();
      await robot.send(4.5, { compact: true });
      while (map.seq !== '10') ({ local_map: map } = await answers.next());
      answers.cancel();
      assert.equal(map.session, 'eve');
      assert.equal(map.odom_from_base.x, 4.5);
      assert.equal(map.map_from_odom.x, 800);
      const { LAYER_ELEVATION: heights, LAYER_SLOPE: slopes } = decodeGrid(map.grid);
      const column = cellAt(4.5, CELL_M) - map.origin_cell_x;
      const row = cellAt(0.1, CELL_M) - map.origin_cell_y;
      const under = row * map.grid.columns + column;
      assert.ok(Math.abs(heights[under] - groundAt(4.5)) < 0.05, `${heights[under]}`);
      assert.ok(Math.abs(slopes[under] - Math.atan(0.05)) < 0.03, `${slopes[under]}`);
    },
  });
});

test('questions about the ground are answered', async () => {
  const points = [
    { x: 1, y: 0 },
    { x: 6.3, y: 0 },
    { x: 1, y: 500 },
  ];
  const { samples, version } = await terrain.SampleHeights({ map: 'plain', points });
  assert.deepEqual(
    samples.map((sample) => sample.state),
    ['STATE_FREE', 'STATE_OBSTACLE', 'STATE_UNKNOWN'],
  );
  assert.ok(Math.abs(samples[0].elevation_m - groundAt(1)) < 0.02);
  // The cell that the tiles have there says the same.
  const key = { level: 0, x: tileOf(cellAt(6.3, CELL_M)), y: 0 };
  const {
    tiles: [tile],
  } = await batch([key], { at: version, encoding: 'CELL_ENCODING_RAW' });
  const index = indexInTile(cellAt(6.3, CELL_M), cellAt(0, CELL_M));
  const value = decodeGrid(tile.grid).LAYER_TRAVERSABILITY[index];
  assert.equal(samples[1].traversability, value);

  const ask = (to) =>
    terrain.CheckPath({
      map: 'plain',
      path: [
        { x: 0, y: 0 },
        { x: to, y: 0 },
      ],
      footprint: { radius_m: 0.3 },
    });
  assert.equal((await ask(3)).free, true);
  const blocked = await ask(8);
  assert.equal(blocked.free, false);
  assert.equal(blocked.worst.ground.state, 'STATE_OBSTACLE');
  assert.ok(Math.abs(blocked.worst.position.x - 6.3) < 1.2, `${blocked.worst.position.x}`);
  assert.ok(blocked.free_distance_m > 3 && blocked.free_distance_m < 6);
});

test('errors say to programs what is wrong', async () => {
  const many = Array.from({ length: 65 }, (_, x) => ({ level: 0, x, y: 0 }));
  const tooMany = await rejected(batch(many));
  assert.equal(tooMany.code, status.INVALID_ARGUMENT);
  assert.equal(errorDetails(tooMany).BadRequest.field_violations[0].field, 'tiles');
  assert.match(tooMany.details, /65/);

  const unknownLayer = await rejected(
    batch([{ level: 0, x: 0, y: 0 }], { layers: ['LAYER_SLOPE'] }),
  );
  assert.equal(errorDetails(unknownLayer).BadRequest.field_violations[0].field, 'layers[0]');

  const ofOldEpoch = { epoch: '1', revision: '1' };
  const expired = await rejected(batch([{ level: 0, x: 0, y: 0 }], { at: ofOldEpoch }));
  assert.equal(expired.code, status.FAILED_PRECONDITION);
  assert.deepEqual(errorDetails(expired).ErrorInfo, { reason: 'REVISION_EXPIRED', domain: 'gem' });

  const missing = await rejected(tiles.GetTileMatrix({ map: 'nowhere', level: 0 }));
  assert.equal(missing.code, status.NOT_FOUND);
});
