#include "core/gpu/radix_sort.h"

#include "core/gpu/launch.h"

namespace gem::gpu {
namespace {

// Six bits: two passes for windows of up to 63 x 63 cells, three for 511 x 511.
constexpr std::uint32_t kDigitBits = 6;
constexpr std::uint32_t kDigits = 1u << kDigitBits;
constexpr std::uint32_t kSortThreads = 128;
constexpr std::uint32_t kItemsPerThread = 8;
// Items of one block.
constexpr std::uint32_t kSortTile = kSortThreads * kItemsPerThread;
// Counters of a digit, one a thread; two more, so that those of the digits lie in different banks.
constexpr std::uint32_t kCounterPitch = kSortThreads + 2;
constexpr std::uint32_t kScanThreads = 256;
constexpr std::uint32_t kScanItems = 4;  // a thread and step

GEM_DEVICE inline std::uint32_t DigitOf(std::uint32_t key, std::uint32_t shift) {
  return (key >> shift) & (kDigits - 1);
}

// The sum over the threads of the block before this one. All threads take part; warp_sums is shared
// memory for a number a warp.
GEM_DEVICE inline std::uint32_t SumBefore(std::uint32_t value, std::uint32_t* warp_sums,
                                          std::uint32_t& total) {
  const std::uint32_t thread = ThreadIndex().x;
  std::uint32_t inclusive = value;  // over the lanes of the warp up to this one
  for (std::uint32_t delta = 1; delta < kWarpLanes; delta *= 2) {
    const std::uint32_t below = ShuffleUp(inclusive, delta);
    if (thread % kWarpLanes >= delta) inclusive += below;
  }
  if (thread % kWarpLanes == kWarpLanes - 1) warp_sums[thread / kWarpLanes] = inclusive;
  SyncThreads();
  std::uint32_t before = inclusive - value;
  total = 0;
  for (std::uint32_t warp = 0; warp < BlockDim().x / kWarpLanes; ++warp) {
    if (warp < thread / kWarpLanes) before += warp_sums[warp];
    total += warp_sums[warp];
  }
  SyncThreads();  // the next sum writes there again
  return before;
}

// Tiles over the items that are left of a sort.
GEM_DEVICE inline std::uint32_t TilesOver(std::uint32_t count) {
  return (count + kSortTile - 1) / kSortTile;
}

// values[i] becomes the sum of all before it. One block: what is scanned here is short. num_items
// != nullptr: over a counter for each digit and tile of so many items, whatever `count` says. total
// may be nullptr.
GEM_KERNEL ExclusiveScan(std::uint32_t* values, std::uint32_t count, const std::uint32_t* num_items,
                         std::uint32_t* total) {
  auto* warp_sums = static_cast<std::uint32_t*>(SharedBytes());
  const std::uint32_t thread = ThreadIndex().x;
  if (num_items != nullptr) count = kDigits * TilesOver(*num_items);
  std::uint32_t sum_of_all = 0;
  for (std::uint32_t begin = 0; begin < count; begin += kScanThreads * kScanItems) {
    const std::uint32_t first = begin + thread * kScanItems;
    std::uint32_t items[kScanItems];
    std::uint32_t own = 0;
    for (std::uint32_t k = 0; k < kScanItems; ++k) {
      items[k] = first + k < count ? values[first + k] : 0;
      own += items[k];
    }
    std::uint32_t sum_of_tile = 0;
    std::uint32_t sum = sum_of_all + SumBefore(own, warp_sums, sum_of_tile);
    for (std::uint32_t k = 0; k < kScanItems; ++k) {
      if (first + k < count) values[first + k] = sum;
      sum += items[k];
    }
    sum_of_all += sum_of_tile;
  }
  if (thread == 0 && total != nullptr) *total = sum_of_all;
}

// ---- leaving out: what has no key goes before anything is sorted, most of it in a small window.

GEM_DEVICE inline std::uint32_t CountKeys(const std::uint32_t* keys, std::uint32_t begin,
                                          std::uint32_t end) {
  std::uint32_t kept = 0;
  for (std::uint32_t i = begin; i < end; ++i) kept += keys[i] != kNoKey ? 1 : 0;
  return kept;
}

// A thread owns neighbouring items.
struct Share {
  std::uint32_t begin, end;
};
GEM_DEVICE inline Share ShareOf(std::uint32_t count) {
  const std::uint32_t begin = BlockIndex().x * kSortTile + ThreadIndex().x * kItemsPerThread;
  if (begin >= count) return {count, count};
  return {begin, begin + kItemsPerThread < count ? begin + kItemsPerThread : count};
}

GEM_KERNEL CountKept(const std::uint32_t* keys, std::uint32_t count, std::uint32_t* kept_of_tile) {
  auto* warp_sums = static_cast<std::uint32_t*>(SharedBytes());
  const Share own = ShareOf(count);
  std::uint32_t kept = 0;
  SumBefore(CountKeys(keys, own.begin, own.end), warp_sums, kept);
  if (ThreadIndex().x == 0) kept_of_tile[BlockIndex().x] = kept;
}

GEM_KERNEL Keep(const std::uint32_t* keys, std::uint32_t count, const std::uint32_t* tile_offsets,
                std::uint32_t* keys_out, std::uint32_t* positions_out) {
  auto* warp_sums = static_cast<std::uint32_t*>(SharedBytes());
  const Share own = ShareOf(count);
  std::uint32_t kept_of_tile = 0;
  std::uint32_t to = tile_offsets[BlockIndex().x] +
                     SumBefore(CountKeys(keys, own.begin, own.end), warp_sums, kept_of_tile);
  for (std::uint32_t i = own.begin; i < own.end; ++i) {
    if (keys[i] == kNoKey) continue;
    keys_out[to] = keys[i];
    positions_out[to++] = i;
  }
}

// ---- sorting by one digit after the other. Blocks beyond the items that are left have nothing to
// do: only the device knows how many those are.

// digit_counts[digit * tiles + tile]: how often a tile has a digit.
GEM_KERNEL CountDigits(const std::uint32_t* keys, const std::uint32_t* num_items,
                       std::uint32_t shift, std::uint32_t* digit_counts) {
  const std::uint32_t count = *num_items;
  if (BlockIndex().x >= TilesOver(count)) return;
  auto* counts = static_cast<std::uint32_t*>(SharedBytes());
  const std::uint32_t thread = ThreadIndex().x;
  if (thread < kDigits) counts[thread] = 0;
  SyncThreads();
  for (std::uint32_t k = 0; k < kItemsPerThread; ++k) {
    const std::uint32_t i = BlockIndex().x * kSortTile + k * kSortThreads + thread;
    if (i < count) AtomicAdd(&counts[DigitOf(keys[i], shift)], 1);
  }
  SyncThreads();
  if (thread < kDigits) digit_counts[thread * TilesOver(count) + BlockIndex().x] = counts[thread];
}

// Moves the items of a tile to where their digit's come, in their order: it suffices to know how
// many of a digit the threads before have.
GEM_KERNEL ScatterByDigit(const std::uint32_t* keys, const std::uint32_t* positions,
                          const std::uint32_t* num_items, std::uint32_t shift,
                          const std::uint32_t* digit_offsets, std::uint32_t* keys_out,
                          std::uint32_t* positions_out) {
  const std::uint32_t count = *num_items;
  if (BlockIndex().x >= TilesOver(count)) return;
  auto* ranks = static_cast<std::uint16_t*>(SharedBytes());
  const std::uint32_t thread = ThreadIndex().x;
  for (std::uint32_t digit = 0; digit < kDigits; ++digit) ranks[digit * kCounterPitch + thread] = 0;
  const Share own = ShareOf(count);
  for (std::uint32_t i = own.begin; i < own.end; ++i) {
    ++ranks[DigitOf(keys[i], shift) * kCounterPitch + thread];
  }
  SyncThreads();
  if (thread < kDigits) {
    std::uint32_t before = 0;
    for (std::uint32_t other = 0; other < kSortThreads; ++other) {
      std::uint16_t& rank = ranks[thread * kCounterPitch + other];
      const std::uint32_t of_other = rank;
      rank = static_cast<std::uint16_t>(before);
      before += of_other;
    }
  }
  SyncThreads();
  for (std::uint32_t i = own.begin; i < own.end; ++i) {
    const std::uint32_t digit = DigitOf(keys[i], shift);
    const std::uint32_t to = digit_offsets[digit * TilesOver(count) + BlockIndex().x] +
                             ranks[digit * kCounterPitch + thread]++;
    keys_out[to] = keys[i];
    positions_out[to] = positions[i];
  }
}

constexpr std::size_t WarpSumsBytes(std::uint32_t threads) {
  return threads / kWarpLanes * sizeof(std::uint32_t);
}

void EnqueueScan(std::uint32_t* values, std::uint32_t count, const std::uint32_t* num_items,
                 std::uint32_t* total, Stream& stream) {
  Launch(ExclusiveScan, {1}, {kScanThreads}, WarpSumsBytes(kScanThreads), stream, values, count,
         num_items, total);
}

}  // namespace

void EnqueueExclusiveScan(std::uint32_t* values, std::uint32_t count, Stream& stream) {
  EnqueueScan(values, count, nullptr, nullptr, stream);
}

absl::Status SortBuffers::Grow(std::uint32_t count) {
  for (int i = 0; i < 2; ++i) {
    GEM_RETURN_IF_ERROR(keys_[i].Grow(count));
    GEM_RETURN_IF_ERROR(positions_[i].Grow(count));
  }
  GEM_RETURN_IF_ERROR(num_items_.Grow(1));
  return digit_counts_.Grow(kDigits * BlocksOver(count, kSortTile));
}

void SortBuffers::EnqueueSort(std::uint32_t count, std::uint32_t key_bits, Stream& stream) {
  const std::uint32_t blocks = BlocksOver(count, kSortTile);
  EnqueueKeep(count, blocks, stream);
  for (std::uint32_t shift = 0; shift < key_bits; shift += kDigitBits) {
    const int next = 1 - now_;
    Launch(CountDigits, {blocks}, {kSortThreads}, kDigits * sizeof(std::uint32_t), stream, keys(),
           num_items(), shift, digit_counts_.data());
    EnqueueScan(digit_counts_.data(), 0, num_items(), nullptr, stream);
    Launch(ScatterByDigit, {blocks}, {kSortThreads},
           kDigits * kCounterPitch * sizeof(std::uint16_t), stream, keys(), positions(),
           num_items(), shift, digit_counts_.data(), keys_[next].data(), positions_[next].data());
    now_ = next;
  }
}

void SortBuffers::EnqueueKeep(std::uint32_t count, std::uint32_t blocks, Stream& stream) {
  const int next = 1 - now_;
  std::uint32_t* const tile_offsets = digit_counts_.data();
  Launch(CountKept, {blocks}, {kSortThreads}, WarpSumsBytes(kSortThreads), stream, keys(), count,
         tile_offsets);
  EnqueueScan(tile_offsets, blocks, nullptr, num_items_.data(), stream);
  Launch(Keep, {blocks}, {kSortThreads}, WarpSumsBytes(kSortThreads), stream, keys(), count,
         tile_offsets, keys_[next].data(), positions_[next].data());
  now_ = next;
}

}  // namespace gem::gpu
