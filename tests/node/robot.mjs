// A robot on a plain: streams scans of the ground round it, and keeps to its credit.
import { Answers } from './protocol.mjs';
import { encodeCompact, encodeFloat32 } from './scan.mjs';

const SENSOR_HEIGHT_M = 1;
const START_NS = 1_700_000_000_000_000_000n;
const PERIOD_NS = 100_000_000n;
export const SCALE_M = 0.004;

const IDENTITY = { x: 0, y: 0, z: 0, qx: 0, qy: 0, qz: 0, qw: 1 };

/// Height of the ground in O, a gentle slope; a wall where x is from 6 to 6.6 m.
export const groundAt = (x) => 0.05 * x + (x >= 6 && x < 6.6 ? 1 : 0);

/// What the sensor sees when the robot stands at x: rings of points up to 4 m away, metres in S.
function pointsAt(x) {
  const points = [];
  for (let dx = -4; dx <= 4; dx += 0.1)
    for (let dy = -4; dy <= 4; dy += 0.1)
      points.push([dx, dy, groundAt(x + dx) - SENSOR_HEIGHT_M - groundAt(x)]);
  return points;
}

export class Robot {
  #stream;
  #answers;
  #seq = 0;
  #credit = 0;
  #fused = 0;
  problems = [];

  /// setup: map, robot and session.
  static async open(ingest, setup) {
    const robot = new Robot();
    robot.#stream = ingest.Ingest();
    robot.#stream.write({
      open: {
        ...setup,
        sensors: [{ name: 'top', base_from_sensor: { ...IDENTITY, z: 1 }, lidar: {} }],
      },
    });
    robot.#answers = new Answers(robot.#stream);
    robot.opened = (await robot.#answers.next()).opened;
    robot.#credit = Number(robot.opened.credit_bytes);
    return robot;
  }

  /// One scan of the ground at x, as FLOAT32 or compact, once there is credit for it. Its bytes.
  async send(x, { compact, points = pointsAt(x) }) {
    const encoded = compact ? encodeCompact(points, SCALE_M) : encodeFloat32(points);
    while (this.#credit < encoded.points.length) await this.#takeAck();
    this.#credit -= encoded.points.length;
    const seq = ++this.#seq;
    this.#stream.write({
      scan: {
        seq: String(seq),
        stamp_ns: String(START_NS + BigInt(seq) * PERIOD_NS),
        sensor: 'top',
        odom_from_base: { ...IDENTITY, x, z: groundAt(x) },
        ...encoded,
      },
    });
    return encoded.points.length;
  }

  async allFused() {
    while (this.#fused < this.#seq) await this.#takeAck();
  }

  /// What the server says at the end.
  async close() {
    this.#stream.write({ close: {} });
    this.#stream.end();
    for (;;) {
      const { ack, closed } = await this.#answers.next();
      if (closed) return closed;
      this.problems.push(...ack.problems);
    }
  }

  async #takeAck() {
    const { ack } = await this.#answers.next();
    this.#credit += Number(ack.credit_bytes);
    this.#fused = Number(ack.fused_seq);
    this.problems.push(...ack.problems);
  }
}
