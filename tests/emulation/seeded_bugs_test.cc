// What the emulation is for: every seeded bug is caught, in the words given here.
#include <gtest/gtest.h>

#include <vector>

#include "tests/emulation/emulation.h"
#include "tests/emulation/seeded_bugs.h"

namespace gem::gpu::emulation {
namespace {

constexpr char kOutOfBounds[] = "a kernel touched memory out of bounds";
constexpr char kHostTouches[] = "the host touched device memory";
constexpr char kWrong[] = "a wrong result";
// Where accesses are not seen one by one, an order of threads may show it, or ThreadSanitizer.
constexpr char kRace[] = "two threads race for one place|a wrong result|data race";
constexpr char kSameBarrier[] = "not all threads of a block come to the same barrier";

struct Seeded {
  Bug bug;
  const char* name;
  const char* caught;
  bool needs_accesses = false;  ///< threads that are switched at barriers only do not show it
};

const Seeded kSeeded[] = {
    {Bug::kNoBoundsGuard, "NoBoundsGuard", kOutOfBounds},
    {Bug::kNoLowerGuard, "NoLowerGuard", kWrong},
    {Bug::kNoBarrier, "NoBarrier", kRace},
    {Bug::kNoBarrierBeforeReuse, "NoBarrierBeforeReuse", kRace},
    {Bug::kBarrierInABranch, "BarrierInABranch", kSameBarrier},
    {Bug::kNarrowHalo, "NarrowHalo", kWrong},
    {Bug::kSharedMemoryTooSmall, "SharedMemoryTooSmall", kOutOfBounds},
    {Bug::kNoMemset, "NoMemset", kWrong},
    {Bug::kMemsetTooShort, "MemsetTooShort", kWrong},
    {Bug::kMinimumNotAtomic, "MinimumNotAtomic", kRace, true},
    {Bug::kSumNotAtomic, "SumNotAtomic", kRace, true},
    {Bug::kOffByOne, "OffByOne", kWrong},
    {Bug::kShuffleInABranch, "ShuffleInABranch", kSameBarrier},
    {Bug::kWarpSumsNotAwaited, "WarpSumsNotAwaited", kRace},
    {Bug::kReadsWhatAnotherBlockWrites, "ReadsWhatAnotherBlockWrites", kRace},
    {Bug::kOrderOfArrival, "OrderOfArrival", kWrong},
    {Bug::kHostPointer, "HostPointer", "a pointer to memory of the host"},
    {Bug::kHostPointerInAStruct, "HostPointerInAStruct", "a pointer to memory of the host"},
    {Bug::kHostReadsDevice, "HostReadsDevice", kHostTouches},
    {Bug::kHostWritesDevice, "HostWritesDevice", kHostTouches},
    {Bug::kNotSynchronised, "NotSynchronised", kWrong},
    {Bug::kPinnedMemoryUsedAgain, "PinnedMemoryUsedAgain", kWrong},
    {Bug::kUsedAfterFree, "UsedAfterFree", kOutOfBounds},
    {Bug::kCopyTooLong, "CopyTooLong", "a copy leaves its allocation"},
    {Bug::kCopyFromPageableMemory, "CopyFromPageableMemory", "a copy leaves its pinned memory"},
};
static_assert(std::size(kSeeded) + 1 == static_cast<std::size_t>(Bug::kNumBugs));

void RunUnderManyOrders(Bug bug) {
  for (unsigned seed = 1; seed <= 8; ++seed) {
    SetSeed(seed);
    if (!ResultsAreRight(bug)) Report("a wrong result");
  }
}

class SeededBugDeathTest : public ::testing::TestWithParam<Seeded> {};

TEST_P(SeededBugDeathTest, IsCaught) {
  EXPECT_DEATH(RunUnderManyOrders(GetParam().bug), GetParam().caught);
}

std::vector<Seeded> SeededThatThisBuildCanSee() {
  std::vector<Seeded> seen;
  for (const Seeded& seeded : kSeeded) {
    if (!seeded.needs_accesses || SeesEveryAccess() || GEM_THREAD_SANITIZER) seen.push_back(seeded);
  }
  return seen;
}

INSTANTIATE_TEST_SUITE_P(All, SeededBugDeathTest, ::testing::ValuesIn(SeededThatThisBuildCanSee()),
                         [](const auto& seeded) { return seeded.param.name; });

TEST(SeededBugs, WithoutABugAllResultsAreRightInEveryOrder) { RunUnderManyOrders(Bug::kNone); }

}  // namespace
}  // namespace gem::gpu::emulation
