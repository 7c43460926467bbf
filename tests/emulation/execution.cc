#include "tests/emulation/execution.h"

#include <algorithm>
#include <numeric>
#include <random>
#include <vector>

#include "tests/emulation/accesses.h"
#include "tests/emulation/device_memory.h"
#include "tests/emulation/emulation.h"
#include "tests/emulation/fibers.h"

namespace gem::gpu {
namespace emulation {
namespace {

enum class State { kReady, kAtBarrier, kAtShuffle, kEnded };

struct Thread {
  Dim index;
  State state = State::kReady;
  std::uint32_t value = 0;  // of a shuffle: what is given, then what was got
  std::uint32_t delta = 0;
};

struct Execution {
  FiberPool fibers;
  std::mt19937 random{1};
  Dim grid, block, block_index;
  std::uint32_t block_number = 0;
  std::uint32_t phase = 0;
  void* shared = nullptr;
  std::vector<Thread> threads;
  std::vector<std::uint32_t> ready;
  std::uint32_t running = 0;
  // What orders threads for ThreadSanitizer: the launch comes before all of them, its end after all
  // of them, and of barriers there are two in turn, as a thread may reach the next one while others
  // still leave this one.
  char begin_order = 0, end_order = 0, barrier_order[2] = {};
};

Execution& Now() {
  static Execution* const execution = new Execution;
  return *execution;
}

Thread& Running() { return Now().threads[Now().running]; }

void Wait(State state) {
  Running().state = state;
  Now().fibers.Yield();
}

// All lanes of a warp that wait for a shuffle get their values.
void Exchange(std::uint32_t warp_begin, std::uint32_t warp_end) {
  Execution& now = Now();
  std::vector<std::uint32_t> given;
  for (std::uint32_t t = warp_begin; t < warp_end; ++t) given.push_back(now.threads[t].value);
  for (std::uint32_t t = warp_begin; t < warp_end; ++t) {
    Thread& thread = now.threads[t];
    const std::uint32_t lane = t - warp_begin;
    if (thread.delta != now.threads[warp_begin].delta)
      Report("lanes of a warp shuffle differently");
    if (lane >= thread.delta) thread.value = given[lane - thread.delta];
    thread.state = State::kReady;
    now.ready.push_back(t);
  }
}

bool AllAre(State state, std::uint32_t begin, std::uint32_t end) {
  const std::vector<Thread>& threads = Now().threads;
  return std::all_of(threads.begin() + begin, threads.begin() + end,
                     [state](const Thread& thread) { return thread.state == state; });
}

// Nobody can go on: warps that are complete shuffle, then a block that is complete passes the
// barrier. False if all threads ended.
bool LetPass() {
  Execution& now = Now();
  const auto count = static_cast<std::uint32_t>(now.threads.size());
  if (AllAre(State::kEnded, 0, count)) return false;
  for (std::uint32_t begin = 0; begin < count; begin += kWarpLanes) {
    const std::uint32_t end = std::min(begin + kWarpLanes, count);
    if (AllAre(State::kAtShuffle, begin, end)) Exchange(begin, end);
  }
  if (!now.ready.empty()) return true;
  if (!AllAre(State::kAtBarrier, 0, count)) {
    Report("not all threads of a block come to the same barrier or shuffle");
  }
  ++now.phase;
  for (std::uint32_t t = 0; t < count; ++t) {
    now.threads[t].state = State::kReady;
    now.ready.push_back(t);
  }
  return true;
}

void RunBlock(const std::function<void()>& thread) {
  Execution& now = Now();
  now.phase = 0;
  now.ready.clear();
  for (std::uint32_t t = 0; t < now.threads.size(); ++t) {
    now.threads[t] = {{t % now.block.x, t / now.block.x}, State::kReady, 0, 0};
    now.ready.push_back(t);
  }
  do {
    while (!now.ready.empty()) {
      std::swap(now.ready[now.random() % now.ready.size()], now.ready.back());
      now.running = now.ready.back();
      now.ready.pop_back();
      if (now.fibers.Resume(now.running, thread)) {
        Running().state = State::kEnded;
      } else if (Running().state == State::kReady) {
        now.ready.push_back(now.running);
      }
    }
  } while (LetPass());
}

}  // namespace

void SetSeed(unsigned seed) { Now().random.seed(seed); }

void RunGrid(Dim grid, Dim block, std::size_t shared_bytes, const std::function<void()>& thread) {
  Execution& now = Now();
  now.grid = grid;
  now.block = block;
  now.threads.resize(block.x * block.y);
  now.fibers.Grow(now.threads.size());
  std::vector<std::uint32_t> order(grid.x * grid.y);
  std::iota(order.begin(), order.end(), 0u);
  std::shuffle(order.begin(), order.end(), now.random);
  const std::function<void()> ordered = [&] {
    AcquireFrom(&now.begin_order);
    thread();
    ReleaseTo(&now.end_order);
  };
  BeginKernelAccesses();
  for (const std::uint32_t number : order) {
    now.block_number = number;
    now.block_index = {number % grid.x, number / grid.x};
    now.shared = PoisonShared(shared_bytes);
    BeginBlockAccesses();
    ReleaseTo(&now.begin_order);
    RunBlock(ordered);
  }
  AcquireFrom(&now.end_order);
}

bool InKernel() { return Now().fibers.in_fiber(); }

ThreadPlace RunningThread() {
  const Execution& now = Now();
  const auto threads = static_cast<std::uint32_t>(now.threads.size());
  return {now.block_number * threads + now.running, now.block_number, now.phase};
}

void MaybeSwitch(unsigned rarity) {
  if (Now().random() % rarity == 0) Now().fibers.Yield();
}

}  // namespace emulation

using emulation::Now;
using emulation::Running;

Dim ThreadIndex() { return Running().index; }
Dim BlockIndex() { return Now().block_index; }
Dim BlockDim() { return Now().block; }
Dim GridDim() { return Now().grid; }
void* SharedBytes() { return Now().shared; }

void SyncThreads() {
  char* const order = &Now().barrier_order[Now().phase % 2];
  emulation::ReleaseTo(order);
  emulation::Wait(emulation::State::kAtBarrier);
  emulation::AcquireFrom(order);
}

std::uint32_t ShuffleUp(std::uint32_t value, std::uint32_t delta) {
  Running().value = value;
  Running().delta = delta;
  emulation::Wait(emulation::State::kAtShuffle);
  return Running().value;
}

std::uint32_t AtomicAdd(std::uint32_t* to, std::uint32_t value) {
  emulation::NoteAtomic(to);
  return __atomic_fetch_add(to, value, __ATOMIC_RELAXED);
}

std::uint32_t AtomicMin(std::uint32_t* to, std::uint32_t value) {
  emulation::NoteAtomic(to);
  std::uint32_t before = __atomic_load_n(to, __ATOMIC_RELAXED);
  while (value < before && !__atomic_compare_exchange_n(to, &before, value, false, __ATOMIC_RELAXED,
                                                        __ATOMIC_RELAXED)) {
  }
  return before;
}

}  // namespace gem::gpu
