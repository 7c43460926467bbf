#include "tests/emulation/seeded_bugs.h"

#include <algorithm>
#include <cstdint>
#include <vector>

#include "core/base/check.h"
#include "core/gpu/buffer.h"
#include "core/gpu/launch.h"

namespace gem::gpu::emulation {
namespace {

constexpr std::uint32_t kThreads = 64;
constexpr std::uint32_t kCount = 200;  // three blocks and a bit
constexpr std::uint32_t kBins = 40;
constexpr std::uint32_t kRadius = 2;

std::uint32_t ValueAt(std::uint32_t i) { return (i * 2654435761u) >> 20; }

// ---- sums over five neighbours

GEM_KERNEL SumNeighbours(const std::uint32_t* in, std::uint32_t count, std::uint32_t* out,
                         Bug bug) {
  auto* tile = static_cast<std::uint32_t*>(SharedBytes());
  const std::uint32_t thread = ThreadIndex().x, i = GlobalIndex();
  const std::uint32_t width = kThreads + 2 * (bug == Bug::kNarrowHalo ? kRadius - 1 : kRadius);
  for (std::uint32_t k = thread; k < width; k += kThreads) {
    const std::uint32_t from = BlockIndex().x * kThreads + k;  // kRadius more than the place
    const bool inside =
        (bug == Bug::kNoLowerGuard || from >= kRadius) && from - kRadius < count + 0u;
    tile[k] = inside || (bug == Bug::kNoLowerGuard && from < kRadius)
                  ? in[static_cast<std::int64_t>(from) - kRadius]
                  : 0;
  }
  if (bug == Bug::kBarrierInABranch && i >= count) return;
  if (bug != Bug::kNoBarrier) SyncThreads();
  std::uint32_t sum = 0;
  for (std::uint32_t k = 0; k <= 2 * kRadius; ++k) sum += tile[thread + k];
  if (bug != Bug::kNoBarrierBeforeReuse) SyncThreads();
  tile[thread] = sum;
  SyncThreads();
  // Pairs of neighbours swap, so that the second use of the tile matters too.
  const std::uint32_t to = i ^ 1u;
  if (bug == Bug::kNoBoundsGuard || to < count) out[to] = tile[thread];
}

// ---- minimum and number of the values in each bin

struct Bins {
  std::uint32_t* lowest;
  std::uint32_t* counts;
};

GEM_KERNEL FillBins(const std::uint32_t* in, std::uint32_t count, Bins bins, Bug bug) {
  const std::uint32_t i = GlobalIndex();
  if (i >= count) return;
  const std::uint32_t bin = in[i] % kBins;
  if (bug == Bug::kMinimumNotAtomic) {
    bins.lowest[bin] = bins.lowest[bin] < in[i] ? bins.lowest[bin] : in[i];
  } else {
    AtomicMin(&bins.lowest[bin], in[i]);
  }
  if (bug == Bug::kSumNotAtomic) {
    bins.counts[bin] += 1;
  } else {
    AtomicAdd(&bins.counts[bin], 1);
  }
}

// ---- prefix sum of a block

GEM_KERNEL ScanBlock(const std::uint32_t* in, std::uint32_t* out, Bug bug) {
  auto* warp_sums = static_cast<std::uint32_t*>(SharedBytes());
  const std::uint32_t thread = ThreadIndex().x, lane = thread % kWarpLanes;
  const std::uint32_t own = in[thread];
  std::uint32_t inclusive = own;
  for (std::uint32_t delta = 1; delta < kWarpLanes; delta *= 2) {
    if (bug == Bug::kShuffleInABranch && lane < delta) continue;
    const std::uint32_t below = ShuffleUp(inclusive, delta);
    if (lane >= delta) inclusive += below;
  }
  if (lane == kWarpLanes - 1) warp_sums[thread / kWarpLanes] = inclusive;
  if (bug != Bug::kWarpSumsNotAwaited) SyncThreads();
  std::uint32_t sum = bug == Bug::kOffByOne ? inclusive : inclusive - own;
  for (std::uint32_t warp = 0; warp < thread / kWarpLanes; ++warp) sum += warp_sums[warp];
  out[thread] = sum;
}

// ---- even values, in their order: places[i] is where value i comes

GEM_KERNEL TakeEven(const std::uint32_t* in, const std::uint32_t* places, std::uint32_t count,
                    std::uint32_t* taken, std::uint32_t* next, Bug bug) {
  const std::uint32_t i = GlobalIndex();
  if (i >= count || in[i] % 2 != 0) return;
  taken[bug == Bug::kOrderOfArrival ? AtomicAdd(next, 1) : places[i]] = in[i];
}

// ---- twice the value of the next

GEM_KERNEL DoubleNext(std::uint32_t* in, std::uint32_t* out, std::uint32_t count, Bug bug) {
  const std::uint32_t i = GlobalIndex();
  if (i >= count) return;
  const std::uint32_t next = in[(i + 1) % count];
  if (bug == Bug::kReadsWhatAnotherBlockWrites) {
    in[i] = 2 * next;  // in place
    out[i] = in[i];
  } else {
    out[i] = 2 * next;
  }
}

// ---- the host

template <typename T>
void GrowOrDie(T& buffer, std::size_t size) {
  GEM_CHECK(buffer.Grow(size).ok());
}

class Programs {
 public:
  explicit Programs(Bug bug) : bug_(bug), stream_(*StreamCreate()) {
    for (std::uint32_t i = 0; i < kCount; ++i) values_.push_back(ValueAt(i));
    GrowOrDie(pinned_in_, kCount);
    GrowOrDie(pinned_out_, kCount);
    GrowOrDie(in_, kCount);
    GrowOrDie(out_, kCount);
    GrowOrDie(lowest_, kBins);
    GrowOrDie(counts_, kBins);
  }
  ~Programs() { StreamDestroy(stream_); }

  bool NeighboursAreRight() {
    Upload();
    const std::size_t shared = (kThreads + 2 * kRadius) * sizeof(std::uint32_t);
    Launch(SumNeighbours, {kBlocks}, {kThreads},
           bug_ == Bug::kSharedMemoryTooSmall ? shared - 16 : shared, *stream_, in_.data(), kCount,
           out_.data(), bug_);
    std::vector<std::uint32_t> expected(kCount, 0);
    for (std::uint32_t i = 0; i < kCount; ++i) {
      for (std::uint32_t k = i < kRadius ? 0 : i - kRadius; k <= std::min(i + kRadius, kCount - 1);
           ++k)
        expected[i ^ 1u] += values_[k];
    }
    return Download() == expected;
  }

  bool BinsAreRight() {
    Upload();
    if (bug_ != Bug::kNoMemset) {
      MemsetAsync(lowest_.data(), 0xff, kBins * sizeof(std::uint32_t), *stream_);
      MemsetAsync(counts_.data(), 0,
                  kBins * (bug_ == Bug::kMemsetTooShort ? 1 : sizeof(std::uint32_t)), *stream_);
    }
    Launch(FillBins, {kBlocks}, {kThreads}, 0, *stream_, in_.data(), kCount,
           Bins{lowest_.data(),
                bug_ == Bug::kHostPointerInAStruct ? pinned_out_.data() : counts_.data()},
           bug_);
    std::vector<std::uint32_t> lowest(kBins, 0xffffffffu), counts(kBins, 0);
    for (const std::uint32_t value : values_) {
      lowest[value % kBins] = std::min(lowest[value % kBins], value);
      ++counts[value % kBins];
    }
    return Download(lowest_.data(), kBins) == lowest && Download(counts_.data(), kBins) == counts;
  }

  bool PrefixSumIsRight() {
    Upload();
    Launch(ScanBlock, {1}, {kThreads}, kThreads / kWarpLanes * sizeof(std::uint32_t), *stream_,
           in_.data(), out_.data(), bug_);
    std::vector<std::uint32_t> expected;
    for (std::uint32_t i = 0, sum = 0; i < kThreads; sum += values_[i++]) expected.push_back(sum);
    return Download(out_.data(), kThreads) == expected;
  }

  bool OrderIsRight() {
    std::vector<std::uint32_t> expected, places;
    for (const std::uint32_t value : values_) {
      places.push_back(static_cast<std::uint32_t>(expected.size()));
      if (value % 2 == 0) expected.push_back(value);
    }
    DeviceBuffer<std::uint32_t> places_device;
    GrowOrDie(places_device, kCount);
    UploadTo(places_device.data(), places);
    Upload();
    MemsetAsync(counts_.data(), 0, sizeof(std::uint32_t), *stream_);
    Launch(TakeEven, {kBlocks}, {kThreads}, 0, *stream_, in_.data(), places_device.data(), kCount,
           out_.data(), counts_.data(), bug_);
    return Download(out_.data(), expected.size()) == expected;
  }

  bool DoublesAreRight() {
    Upload();
    if (bug_ == Bug::kPinnedMemoryUsedAgain) std::fill_n(pinned_in_.data(), kCount, 7u);
    Launch(DoubleNext, {kBlocks}, {kThreads}, 0, *stream_,
           bug_ == Bug::kHostPointer ? pinned_in_.data() : in_.data(), out_.data(), kCount, bug_);
    std::vector<std::uint32_t> expected;
    for (std::uint32_t i = 0; i < kCount; ++i) expected.push_back(2 * values_[(i + 1) % kCount]);
    const bool right = Download() == expected;
    if (bug_ == Bug::kHostReadsDevice) return right && out_.data()[0] == expected[0];
    if (bug_ == Bug::kHostWritesDevice) in_.data()[0] = 1;
    return right;
  }

  bool FreedMemoryIsLeftAlone() {
    std::uint32_t* freed = nullptr;
    {
      DeviceBuffer<std::uint32_t> buffer;
      GrowOrDie(buffer, kCount);
      freed = buffer.data();
      MemsetAsync(freed, 0, kCount * sizeof(std::uint32_t), *stream_);
      GEM_CHECK(StreamSynchronize(*stream_).ok());
    }
    if (bug_ != Bug::kUsedAfterFree) return true;
    Launch(DoubleNext, {kBlocks}, {kThreads}, 0, *stream_, freed, out_.data(), kCount, bug_);
    return StreamSynchronize(*stream_).ok();
  }

 private:
  static constexpr std::uint32_t kBlocks = BlocksOver(kCount, kThreads);

  void Upload() { UploadTo(in_.data(), values_); }

  void UploadTo(std::uint32_t* device, const std::vector<std::uint32_t>& values) {
    GEM_CHECK(StreamSynchronize(*stream_).ok());
    std::copy(values.begin(), values.end(), pinned_in_.data());
    const std::size_t extra = bug_ == Bug::kCopyTooLong ? 4 : 0;
    MemcpyToDeviceAsync(device,
                        bug_ == Bug::kCopyFromPageableMemory ? values.data() : pinned_in_.data(),
                        values.size() * sizeof(std::uint32_t) + extra, *stream_);
  }

  std::vector<std::uint32_t> Download() { return Download(out_.data(), kCount); }
  std::vector<std::uint32_t> Download(const std::uint32_t* device, std::size_t count) {
    MemcpyToHostAsync(pinned_out_.data(), device, count * sizeof(std::uint32_t), *stream_);
    if (bug_ != Bug::kNotSynchronised) GEM_CHECK(StreamSynchronize(*stream_).ok());
    return {pinned_out_.data(), pinned_out_.data() + count};
  }

  const Bug bug_;
  Stream* const stream_;
  std::vector<std::uint32_t> values_;
  PinnedBuffer<std::uint32_t> pinned_in_, pinned_out_;
  DeviceBuffer<std::uint32_t> in_, out_, lowest_, counts_;
};

}  // namespace

bool ResultsAreRight(Bug bug) {
  Programs programs(bug);
  return programs.NeighboursAreRight() && programs.BinsAreRight() && programs.PrefixSumIsRight() &&
         programs.OrderIsRight() && programs.DoublesAreRight() && programs.FreedMemoryIsLeftAlone();
}

}  // namespace gem::gpu::emulation
