// ENCODINGS.md, "Scans": gem.v1.Scan to points, and points to scans.
import { Refused, inflated, stored } from './frame.mjs';

const WIDTHS = { TYPE_UINT8: 1, TYPE_UINT16: 2, TYPE_INT16: 2, TYPE_UINT32: 4, TYPE_FLOAT32: 4 };
const DEPTH_M_MAX = 1000;

/// Every byte of a point in one column of 1, 2 or 4 bytes.
function columnsOf(fields, stride) {
  const owner = new Array(stride).fill(false);
  const columns = [];
  for (const { offset, type } of fields) {
    const bytes = Array.from({ length: WIDTHS[type] }, (_, i) => offset + i);
    if (bytes.some((byte) => owner[byte])) continue;
    for (const byte of bytes) owner[byte] = true;
    columns.push({ offset, width: bytes.length });
  }
  owner.forEach((owned, offset) => owned || columns.push({ offset, width: 1 }));
  return columns.sort((a, b) => a.offset - b.offset);
}

const readWord = { 1: 'readUInt8', 2: 'readUInt16LE', 4: 'readUInt32LE' };
const writeWord = { 1: 'writeUInt8', 2: 'writeUInt16LE', 4: 'writeUInt32LE' };

/// Of w bits, unsigned.
const wrapped = (value, width) => (width === 4 ? value >>> 0 : value & ((1 << (8 * width)) - 1));

function zigzag(difference, width) {
  const shift = 32 - 8 * width;
  const signed = (difference << shift) >> shift;
  return wrapped((signed << 1) ^ (signed >> 31), width);
}

const unzigzag = (code) => (code >>> 1) ^ -(code & 1);

export function encodeDeltas(points, fields, stride) {
  const count = points.length / stride;
  const planes = Buffer.alloc(points.length);
  for (const { offset, width } of columnsOf(fields, stride)) {
    let before = 0;
    for (let i = 0; i < count; ++i) {
      const value = points[readWord[width]](i * stride + offset);
      const code = zigzag(value - before, width);
      for (let b = 0; b < width; ++b) planes[(offset + b) * count + i] = (code >>> (8 * b)) & 255;
      before = value;
    }
  }
  return planes;
}

export function decodeDeltas(planes, fields, stride) {
  const count = planes.length / stride;
  const points = Buffer.alloc(planes.length);
  for (const { offset, width } of columnsOf(fields, stride)) {
    let before = 0;
    for (let i = 0; i < count; ++i) {
      let code = 0;
      for (let b = 0; b < width; ++b) code |= planes[(offset + b) * count + i] << (8 * b);
      before = wrapped(before + unzigzag(wrapped(code, width)), width);
      points[writeWord[width]](before, i * stride + offset);
    }
  }
  return points;
}

function checkLayout(scan) {
  for (const field of scan.fields) {
    if (!(field.type in WIDTHS)) throw new Refused(`type ${field.type}`);
    if (field.offset + WIDTHS[field.type] > scan.point_stride)
      throw new Refused(`field ${field.name} at ${field.offset}`);
  }
  for (const name of ['x', 'y', 'z'])
    if (!scan.fields.some((field) => field.name === name)) throw new Refused(`no ${name}`);
}

/// The points as they were packed.
export function packedPoints(scan) {
  checkLayout(scan);
  const size = scan.point_count * scan.point_stride;
  switch (scan.compression) {
    case 'SCAN_COMPRESSION_UNSPECIFIED':
    case 'SCAN_COMPRESSION_NONE':
      if (scan.points.length !== size)
        throw new Refused(`${scan.points.length} bytes, want ${size}`);
      return scan.points;
    case 'SCAN_COMPRESSION_ZSTD':
      return inflated(scan.points, size);
    case 'SCAN_COMPRESSION_DELTA_ZSTD':
      return decodeDeltas(inflated(scan.points, size), scan.fields, scan.point_stride);
    default:
      throw new Refused(`compression ${scan.compression}`);
  }
}

function coordinate(packed, at, { offset, type, scale }) {
  if (type === 'TYPE_FLOAT32') return packed.readFloatLE(at + offset);
  return Math.fround(packed.readInt16LE(at + offset) * Math.fround(scale || 1));
}

function timeOffset(packed, at, { offset, type }) {
  if (type === 'TYPE_FLOAT32') return packed.readFloatLE(at + offset);
  return Math.fround(packed.readUInt32LE(at + offset) * 1e-9);
}

function decodePoints(scan) {
  const packed = packedPoints(scan);
  const field = (...names) => scan.fields.find(({ name }) => names.includes(name));
  const axes = ['x', 'y', 'z'].map((name) => field(name));
  const rgba = field('rgba');
  const t = field('t', 'time_offset');
  const decoded = { points: [], colors: [], time_offsets_s: [] };
  for (let at = 0; at < packed.length; at += scan.point_stride) {
    const point = axes.map((axis) => coordinate(packed, at, axis));
    if (!point.every(Number.isFinite))
      throw new Refused(`point ${decoded.points.length}: ${point}`);
    decoded.points.push(point);
    if (rgba) {
      const [r, g, b, alpha] = packed.subarray(at + rgba.offset, at + rgba.offset + 4);
      decoded.colors.push(alpha === 0 ? null : [r, g, b]);
    }
    if (t) decoded.time_offsets_s.push(timeOffset(packed, at, t));
  }
  return decoded;
}

function depthPixels(scan) {
  const image = scan.depth_image;
  const count = image.width * image.height;
  const size = count * (image.encoding === 'ENCODING_UINT16' ? 2 : 4);
  switch (scan.compression) {
    case 'SCAN_COMPRESSION_UNSPECIFIED':
    case 'SCAN_COMPRESSION_NONE':
      return { depth: image.depth, rgb: image.rgb };
    case 'SCAN_COMPRESSION_ZSTD':
      return {
        depth: inflated(image.depth, size),
        rgb: image.rgb.length === 0 ? image.rgb : inflated(image.rgb, 3 * count),
      };
    default:
      throw new Refused(`compression ${scan.compression} of a depth image`);
  }
}

function decodeDepthImage(scan) {
  const image = scan.depth_image;
  const { depth, rgb } = depthPixels(scan);
  const decoded = { points: [], colors: [], time_offsets_s: [], depth, rgb };
  const step = image.step || 1;
  for (let v = 0; v < image.height; v += step)
    for (let u = 0; u < image.width; u += step) {
      const i = v * image.width + u;
      const z =
        image.encoding === 'ENCODING_UINT16'
          ? depth.readUInt16LE(2 * i) * (image.scale || 0.001)
          : depth.readFloatLE(4 * i);
      if (!(z > 0 && z <= DEPTH_M_MAX)) continue;
      decoded.points.push([((u - image.cx) / image.fx) * z, ((v - image.cy) / image.fy) * z, z]);
      if (rgb.length > 0) decoded.colors.push([...rgb.subarray(3 * i, 3 * i + 3)]);
    }
  return decoded;
}

export function decodeScan(scan) {
  return scan.depth_image ? decodeDepthImage(scan) : decodePoints(scan);
}

const XYZ = ['x', 'y', 'z'];

/// Points and their layout, for a scan. points: [[x, y, z], ...], metres in S.
export function encodeFloat32(points) {
  const bytes = Buffer.alloc(12 * points.length);
  points.flat().forEach((value, i) => bytes.writeFloatLE(value, 4 * i));
  const fields = XYZ.map((name, i) => ({ name, offset: 4 * i, type: 'TYPE_FLOAT32' }));
  return { point_count: points.length, point_stride: 12, fields, points: bytes };
}

/// In INT16 with a scale, as differences in a frame.
export function encodeCompact(points, scale) {
  const bytes = Buffer.alloc(6 * points.length);
  points.flat().forEach((value, i) => bytes.writeInt16LE(Math.round(value / scale), 2 * i));
  const fields = XYZ.map((name, i) => ({ name, offset: 2 * i, type: 'TYPE_INT16', scale }));
  return {
    point_count: points.length,
    point_stride: 6,
    fields,
    points: stored(encodeDeltas(bytes, fields, 6)),
    compression: 'SCAN_COMPRESSION_DELTA_ZSTD',
  };
}
