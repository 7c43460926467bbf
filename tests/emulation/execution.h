// Runs one kernel: blocks and threads in shuffled order. Implements core/gpu/device.h.
#pragma once

#include <cstddef>
#include <functional>

#include "core/gpu/device.h"

namespace gem::gpu::emulation {

/// Calls thread() once for every thread of the grid.
void RunGrid(Dim grid, Dim block, std::size_t shared_bytes, const std::function<void()>& thread);

/// True on the stack of a kernel's thread.
bool InKernel();

/// Number of the running thread in the grid, of its block, and of the barriers that it passed.
struct ThreadPlace {
  std::uint32_t thread;
  std::uint32_t block;
  std::uint32_t phase;
};
ThreadPlace RunningThread();

/// Another thread runs on, now and then: as often as 1 in `rarity`.
void MaybeSwitch(unsigned rarity);

}  // namespace gem::gpu::emulation
