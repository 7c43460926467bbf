// Small programs for the device with one bug each, of the kinds that real kernels have: the
// emulation must catch every one of them, or it is not worth its lines.
#pragma once

#include <vector>

namespace gem::gpu::emulation {

enum class Bug {
  kNone,
  // In kernels that look at neighbours through shared memory.
  kNoBoundsGuard,
  kNoLowerGuard,
  kNoBarrier,
  kNoBarrierBeforeReuse,
  kBarrierInABranch,
  kNarrowHalo,
  kSharedMemoryTooSmall,
  // In kernels that count and take minima.
  kNoMemset,
  kMemsetTooShort,
  kMinimumNotAtomic,
  kSumNotAtomic,
  // In prefix sums.
  kOffByOne,
  kShuffleInABranch,
  kWarpSumsNotAwaited,
  // Between blocks.
  kReadsWhatAnotherBlockWrites,
  kOrderOfArrival,
  // On the host.
  kHostPointer,
  kHostPointerInAStruct,
  kHostReadsDevice,
  kHostWritesDevice,
  kNotSynchronised,
  kPinnedMemoryUsedAgain,
  kUsedAfterFree,
  kCopyTooLong,
  kCopyFromPageableMemory,
  kNumBugs,
};

/// Runs every program, with the bug in the one that it belongs to. True if all results are right.
bool ResultsAreRight(Bug bug);

}  // namespace gem::gpu::emulation
