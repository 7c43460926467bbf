// ENCODINGS.md, "frame": one complete zstd frame whose header holds the content size. Nothing is
// inflated before all of that is known, and never to more than was expected.
import { decompress } from 'fzstd';

export class Refused extends Error {}

const MAGIC = 0xfd2fb528;
const BLOCK_BYTES_MAX = 128 * 1024;

/// RFC 8878, 3.1.1: how the frame begins.
function header(bytes) {
  if (bytes.length < 6 || bytes.readUInt32LE(0) !== MAGIC) throw new Refused('not a zstd frame');
  const descriptor = bytes[4];
  const singleSegment = (descriptor >> 5) & 1;
  const sizeFlag = descriptor >> 6;
  const contentSizeBytes = sizeFlag === 0 ? singleSegment : 1 << sizeFlag;
  if (contentSizeBytes === 0) throw new Refused('a zstd frame without its content size');
  const dictionaryBytes = [0, 1, 2, 4][descriptor & 3];
  const at = 5 + (singleSegment ? 0 : 1) + dictionaryBytes;
  if (bytes.length < at + contentSizeBytes) throw new Refused('a zstd frame that is cut short');
  let contentSize = 0;
  for (let i = contentSizeBytes - 1; i >= 0; --i) contentSize = contentSize * 256 + bytes[at + i];
  if (contentSizeBytes === 2) contentSize += 256;
  return { contentSize, blocksAt: at + contentSizeBytes, hasChecksum: (descriptor >> 2) & 1 };
}

/// RFC 8878, 3.1.1.2: where the frame ends.
function endOf(bytes, { blocksAt, hasChecksum }) {
  let at = blocksAt;
  for (let last = false; !last;) {
    if (at + 3 > bytes.length) throw new Refused('a zstd frame that is cut short');
    const block = bytes.readUIntLE(at, 3);
    last = (block & 1) === 1;
    const isRunLength = ((block >> 1) & 3) === 1;
    at += 3 + (isRunLength ? 1 : block >> 3);
  }
  return at + (hasChecksum ? 4 : 0);
}

export function inflated(bytes, size) {
  const frame = header(bytes);
  if (frame.contentSize !== size)
    throw new Refused(`a zstd frame of ${frame.contentSize} bytes, want ${size}`);
  const end = endOf(bytes, frame);
  if (end > bytes.length) throw new Refused('a zstd frame that is cut short');
  if (end < bytes.length) throw new Refused('bytes behind a zstd frame');
  return Buffer.from(decompress(bytes, new Uint8Array(size)));
}

/// A frame of blocks that are stored as they are: what every decoder of zstd takes.
export function stored(bytes) {
  const head = Buffer.alloc(9);
  head.writeUInt32LE(MAGIC, 0);
  head[4] = 0xa0; // single segment, content size in 4 bytes
  head.writeUInt32LE(bytes.length, 5);
  const parts = [head];
  for (let begin = 0; begin === 0 || begin < bytes.length; begin += BLOCK_BYTES_MAX) {
    const block = bytes.subarray(begin, begin + BLOCK_BYTES_MAX);
    const isLast = begin + BLOCK_BYTES_MAX >= bytes.length;
    const blockHead = Buffer.alloc(3);
    blockHead.writeUIntLE((block.length << 3) | (isLast ? 1 : 0), 0, 3);
    parts.push(blockHead, block);
  }
  return Buffer.concat(parts);
}
