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

GEM_DEVICE inline std::uint32_t DigitOf(std::uint32_t key, std::uint32_t shift) {
  return (key >> shift) & (kDigits - 1);
}

// digit_counts[digit * blocks + block]: how often a tile has a digit.
GEM_KERNEL CountDigits(const std::uint32_t* keys, std::uint32_t count, std::uint32_t shift,
                       std::uint32_t* digit_counts) {
  auto* counts = static_cast<std::uint32_t*>(SharedBytes());
  const std::uint32_t thread = ThreadIndex().x;
  if (thread < kDigits) counts[thread] = 0;
  SyncThreads();
  for (std::uint32_t k = 0; k < kItemsPerThread; ++k) {
    const std::uint32_t i = BlockIndex().x * kSortTile + k * kSortThreads + thread;
    if (i < count) AtomicAdd(&counts[DigitOf(keys[i], shift)], 1);
  }
  SyncThreads();
  if (thread < kDigits) digit_counts[thread * GridDim().x + BlockIndex().x] = counts[thread];
}

// values[i] becomes the sum of all before it. One block: what is scanned here is short.
GEM_KERNEL ExclusiveScan(std::uint32_t* values, std::uint32_t count) {
  auto* warp_sums = static_cast<std::uint32_t*>(SharedBytes());
  const std::uint32_t thread = ThreadIndex().x;
  const std::uint32_t share = (count + kScanThreads - 1) / kScanThreads;
  const std::uint32_t begin = thread * share < count ? thread * share : count;
  const std::uint32_t end = begin + share < count ? begin + share : count;
  std::uint32_t own = 0;
  for (std::uint32_t i = begin; i < end; ++i) own += values[i];

  std::uint32_t inclusive = own;  // over the lanes of the warp up to this one
  for (std::uint32_t delta = 1; delta < kWarpLanes; delta *= 2) {
    const std::uint32_t below = ShuffleUp(inclusive, delta);
    if (thread % kWarpLanes >= delta) inclusive += below;
  }
  if (thread % kWarpLanes == kWarpLanes - 1) warp_sums[thread / kWarpLanes] = inclusive;
  SyncThreads();
  std::uint32_t sum = inclusive - own;
  for (std::uint32_t warp = 0; warp < thread / kWarpLanes; ++warp) sum += warp_sums[warp];
  for (std::uint32_t i = begin; i < end; ++i) {
    const std::uint32_t value = values[i];
    values[i] = sum;
    sum += value;
  }
}

// Moves the items of a tile to where their digit's come, in their order. A thread owns
// neighbouring items, so it suffices to know how many of a digit the threads before it have.
// positions == nullptr: the first pass, an item's value is its position.
GEM_KERNEL ScatterByDigit(const std::uint32_t* keys, const std::uint32_t* positions,
                          std::uint32_t count, std::uint32_t shift,
                          const std::uint32_t* digit_offsets, std::uint32_t* keys_out,
                          std::uint32_t* positions_out) {
  auto* ranks = static_cast<std::uint16_t*>(SharedBytes());
  const std::uint32_t thread = ThreadIndex().x;
  for (std::uint32_t digit = 0; digit < kDigits; ++digit) ranks[digit * kCounterPitch + thread] = 0;
  const std::uint32_t begin = BlockIndex().x * kSortTile + thread * kItemsPerThread;
  const std::uint32_t end = begin + kItemsPerThread < count ? begin + kItemsPerThread : count;
  for (std::uint32_t i = begin; i < end; ++i) {
    ++ranks[DigitOf(keys[i], shift) * kCounterPitch + thread];
  }
  SyncThreads();
  if (thread < kDigits) {
    std::uint32_t before = 0;
    for (std::uint32_t other = 0; other < kSortThreads; ++other) {
      std::uint16_t& rank = ranks[thread * kCounterPitch + other];
      const std::uint32_t own = rank;
      rank = static_cast<std::uint16_t>(before);
      before += own;
    }
  }
  SyncThreads();
  for (std::uint32_t i = begin; i < end; ++i) {
    const std::uint32_t digit = DigitOf(keys[i], shift);
    const std::uint32_t to = digit_offsets[digit * GridDim().x + BlockIndex().x] +
                             ranks[digit * kCounterPitch + thread]++;
    keys_out[to] = keys[i];
    positions_out[to] = positions != nullptr ? positions[i] : i;
  }
}

}  // namespace

void EnqueueExclusiveScan(std::uint32_t* values, std::uint32_t count, Stream& stream) {
  Launch(ExclusiveScan, {1}, {kScanThreads}, kScanThreads / kWarpLanes * sizeof(std::uint32_t),
         stream, values, count);
}

absl::Status SortBuffers::Grow(std::uint32_t count) {
  for (int i = 0; i < 2; ++i) {
    GEM_RETURN_IF_ERROR(keys_[i].Grow(count));
    GEM_RETURN_IF_ERROR(positions_[i].Grow(count));
  }
  return digit_counts_.Grow(kDigits * BlocksOver(count, kSortTile));
}

void SortBuffers::EnqueueSort(std::uint32_t count, std::uint32_t key_bits, Stream& stream) {
  const std::uint32_t blocks = BlocksOver(count, kSortTile);
  for (std::uint32_t shift = 0; shift < key_bits; shift += kDigitBits) {
    const int next = 1 - now_;
    Launch(CountDigits, {blocks}, {kSortThreads}, kDigits * sizeof(std::uint32_t), stream, keys(),
           count, shift, digit_counts_.data());
    EnqueueExclusiveScan(digit_counts_.data(), kDigits * blocks, stream);
    Launch(ScatterByDigit, {blocks}, {kSortThreads},
           kDigits * kCounterPitch * sizeof(std::uint16_t), stream, keys(),
           shift == 0 ? nullptr : positions(), count, shift, digit_counts_.data(),
           keys_[next].data(), positions_[next].data());
    now_ = next;
  }
}

}  // namespace gem::gpu
