// Every access of a kernel to memory, where the compiler tells of it: kernels are compiled with
// -fsanitize=thread, but its run-time library is not linked. What it would be told is told to the
// functions in accesses.cc, which switch threads between accesses and find races: two threads, one
// place, at least one write, and neither a barrier between them nor both atomic.
#pragma once

namespace gem::gpu::emulation {

/// What went before is ordered before everything in this kernel.
void BeginKernelAccesses();
/// The shared memory is that of a new block.
void BeginBlockAccesses();

void NoteAtomic(const void* memory);

}  // namespace gem::gpu::emulation
