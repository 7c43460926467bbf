// The calls of the CUDA runtime that we use, and nothing else of it: no CUDA header is seen here,
// so host code compiles without the toolkit. cuda_runtime.cc implements them with CUDA, and
// tests/emulation with plain memory that the host may not touch and streams that run late.
#pragma once

#include <cstddef>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

namespace gem::gpu {

/// What runs on the device in the order in which it was enqueued, behind the host's back.
class Stream;

/// OK if there is a device that can be used; else UNAVAILABLE with the driver's reason.
absl::Status DeviceStatus();

/// RESOURCE_EXHAUSTED if there is no such memory. Content is undefined.
absl::StatusOr<void*> Malloc(std::size_t size_bytes);
void Free(void* device);

/// Pinned memory of the host, the only one that MemcpyAsync takes.
absl::StatusOr<void*> HostAlloc(std::size_t size_bytes);
void HostFree(void* host);

absl::StatusOr<Stream*> StreamCreate();
/// Waits for what is enqueued.
void StreamDestroy(Stream* stream);

// What follows only enqueues. A failure is kept by the stream: StreamSynchronize tells it.
void MemcpyToDeviceAsync(void* device, const void* pinned, std::size_t size_bytes, Stream& stream);
void MemcpyToHostAsync(void* pinned, const void* device, std::size_t size_bytes, Stream& stream);
void MemsetAsync(void* device, int byte, std::size_t size_bytes, Stream& stream);
/// A mark in the stream, for ElapsedSeconds. 0 <= mark < kMarks.
inline constexpr int kMarks = 8;
void MarkAsync(int mark, Stream& stream);

/// Waits until all that was enqueued has run. The first failure since the stream began, if any.
absl::Status StreamSynchronize(Stream& stream);

/// Time on the device between two marks that have run.
double ElapsedSeconds(int from, int to, const Stream& stream);

}  // namespace gem::gpu
