// A GPU on the host, for tests: executes the very sources that nvcc compiles. Blocks run one after
// the other in shuffled order, their threads as fibers in shuffled order; device memory is out of
// the host's reach but while a stream runs; streams run as late as they may. What a real device
// would punish with wrong numbers now and then ends the process here, with a line that says why.
//
// One host thread at a time.
#pragma once

namespace gem::gpu::emulation {

/// Order of blocks and threads from here on.
void SetSeed(unsigned seed);

/// 1 at first. Without a device DeviceStatus() fails.
void SetDeviceCount(int count);

/// From now on `count` more allocations on the device succeed; -1: all.
void FailMallocAfter(int count);
/// The next kernel ends with a failure that StreamSynchronize tells, as all of the stream after it.
void FailNextKernel();

/// Allocations on the device and of pinned memory so far.
int num_allocations();
int num_launches();

/// True where kernels were compiled so that each of their accesses to memory is seen: then threads
/// are also switched between two accesses, and a race of two threads is reported as such. Needs
/// compiler support that a build with sanitizers uses otherwise.
bool SeesEveryAccess();

/// Ends the process: "emulation: what".
[[noreturn]] void Report(const char* what);

}  // namespace gem::gpu::emulation
