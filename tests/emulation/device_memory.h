// Device memory that the host cannot touch: every allocation ends at a page that is never there,
// and is itself there only while a stream runs. Addresses are not used twice, so what was freed
// stays out of reach.
#pragma once

#include <cstddef>
#include <cstdint>

namespace gem::gpu::emulation {

/// The bytes of memory that nobody wrote: large and negative as a float, out of bounds as an index.
inline constexpr unsigned char kPoison = 0xcb;

/// nullptr if `size_bytes` do not fit.
void* AllocateDevice(std::size_t size_bytes);
void FreeDevice(void* memory);

/// Opens all device memory to accesses, and closes it again; checks that nothing was written just
/// before an allocation.
void OpenDevice();
void CloseDevice();

/// True if [memory, memory + size_bytes) lies in one allocation.
bool IsDevice(const void* memory, std::size_t size_bytes);

/// The shared memory of the running block, poisoned anew. At most 48 KiB, as on a real device.
void* PoisonShared(std::size_t size_bytes);

/// True for anything that kernels share, also for what lies between allocations.
bool InDeviceRange(const void* memory);
bool IsShared(std::uintptr_t address);

/// Tells on a fault in the device's range who did it; other faults are handed on.
void InstallFaultHandler(bool (*in_kernel)());

}  // namespace gem::gpu::emulation
