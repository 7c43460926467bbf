// core/gpu/runtime.h over the emulation: memory of device_memory.h, streams that run only when
// somebody waits for them.
#include "core/gpu/runtime.h"

#include <sys/syscall.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <functional>
#include <initializer_list>
#include <map>
#include <set>
#include <utility>
#include <vector>

#include "core/gpu/launch.h"
#include "tests/emulation/device_memory.h"
#include "tests/emulation/emulation.h"
#include "tests/emulation/execution.h"

namespace gem::gpu {

class Stream {
 public:
  std::vector<std::function<void()>> queue;
  std::array<std::chrono::steady_clock::time_point, kMarks> marks;
  absl::Status status;
};

namespace emulation {
namespace {

struct Machine {
  int device_count = 1;
  int mallocs_left = -1;
  bool fail_next_kernel = false;
  int num_allocations = 0;
  int num_launches = 0;
  std::map<const unsigned char*, std::size_t> pinned;  // by begin
  std::set<Stream*> streams;
};

Machine& TheMachine() {
  static Machine* const machine = [] {
    InstallFaultHandler(&InKernel);
    return new Machine;
  }();
  return *machine;
}

void Run(Stream& stream) {
  OpenDevice();
  for (const std::function<void()>& work : stream.queue) {
    if (!stream.status.ok()) break;  // a failure ends all that comes after it
    work();
  }
  stream.queue.clear();
  CloseDevice();
}

bool IsPinned(const void* memory, std::size_t size_bytes) {
  const auto& pinned = TheMachine().pinned;
  const auto* begin = static_cast<const unsigned char*>(memory);
  auto after = pinned.upper_bound(begin);
  if (after == pinned.begin()) return false;
  --after;
  return begin + size_bytes <= after->first + after->second;
}

void CheckCopy(const void* device, const void* pinned, std::size_t size_bytes) {
  if (!IsDevice(device, size_bytes)) Report("a copy leaves its allocation on the device");
  if (!IsPinned(pinned, size_bytes)) Report("a copy leaves its pinned memory of the host");
}

// The kernel looks at the address before it finds that there is no such operation on signals.
bool IsReadable(const void* memory) {
  syscall(SYS_rt_sigprocmask, ~0, memory, nullptr, 8);
  return errno != EFAULT;
}

// True for what looks like an address and is one of the host: there is memory at it.
bool PointsToHost(std::uint64_t word) {
  // Stacks, heaps and libraries of 64-bit Linux; numbers are rarely so large and rarely so small.
  if (word >> 32 < 0x5500u || word >> 32 > 0xffffu) return false;
  const auto memory = reinterpret_cast<const void*>(word & ~std::uint64_t{7});
  return !InDeviceRange(memory) && IsReadable(memory);
}

void CheckParameter(const ParameterBytes& parameter) {
  const auto* bytes = static_cast<const unsigned char*>(parameter.data);
  for (std::size_t i = 0; i + sizeof(std::uint64_t) <= parameter.size_bytes;
       i += sizeof(std::uint64_t)) {
    std::uint64_t word;
    std::memcpy(&word, bytes + i, sizeof(word));
    if (PointsToHost(word)) Report("a kernel is given a pointer to memory of the host");
  }
}

}  // namespace

void SetDeviceCount(int count) { TheMachine().device_count = count; }
void FailMallocAfter(int count) { TheMachine().mallocs_left = count; }
void FailNextKernel() { TheMachine().fail_next_kernel = true; }
int num_allocations() { return TheMachine().num_allocations; }
int num_launches() { return TheMachine().num_launches; }

}  // namespace emulation

using emulation::TheMachine;

absl::Status DeviceStatus() {
  return TheMachine().device_count > 0 ? absl::OkStatus()
                                       : absl::UnavailableError("no CUDA device: emulated");
}

absl::StatusOr<void*> Malloc(std::size_t size_bytes) {
  if (TheMachine().mallocs_left == 0) return absl::ResourceExhaustedError("out of device memory");
  if (TheMachine().mallocs_left > 0) --TheMachine().mallocs_left;
  ++TheMachine().num_allocations;
  void* const memory = emulation::AllocateDevice(size_bytes);
  if (memory == nullptr) return absl::ResourceExhaustedError("out of device memory");
  return memory;
}

void Free(void* device) {
  // As cudaFree does: nothing runs any more that could use it.
  for (Stream* stream : TheMachine().streams) emulation::Run(*stream);
  emulation::FreeDevice(device);
}

absl::StatusOr<void*> HostAlloc(std::size_t size_bytes) {
  ++TheMachine().num_allocations;
  auto* memory = new unsigned char[size_bytes];
  std::memset(memory, emulation::kPoison, size_bytes);
  TheMachine().pinned[memory] = size_bytes;
  return memory;
}
void HostFree(void* host) {
  TheMachine().pinned.erase(static_cast<unsigned char*>(host));
  delete[] static_cast<unsigned char*>(host);
}

absl::StatusOr<Stream*> StreamCreate() {
  auto* stream = new Stream;
  TheMachine().streams.insert(stream);
  return stream;
}
void StreamDestroy(Stream* stream) {
  emulation::Run(*stream);
  TheMachine().streams.erase(stream);
  delete stream;
}

void MemcpyToDeviceAsync(void* device, const void* pinned, std::size_t size_bytes, Stream& stream) {
  emulation::CheckCopy(device, pinned, size_bytes);
  stream.queue.push_back([=] { std::memcpy(device, pinned, size_bytes); });
}
void MemcpyToHostAsync(void* pinned, const void* device, std::size_t size_bytes, Stream& stream) {
  emulation::CheckCopy(device, pinned, size_bytes);
  stream.queue.push_back([=] { std::memcpy(pinned, device, size_bytes); });
}
void MemsetAsync(void* device, int byte, std::size_t size_bytes, Stream& stream) {
  if (!emulation::IsDevice(device, size_bytes)) {
    emulation::Report("a memset leaves its allocation on the device");
  }
  stream.queue.push_back([=] { std::memset(device, byte, size_bytes); });
}
void MarkAsync(int mark, Stream& stream) {
  stream.queue.push_back([mark, &stream] {
    stream.marks[static_cast<std::size_t>(mark)] = std::chrono::steady_clock::now();
  });
}

void EnqueueKernel(Dim grid, Dim block, std::size_t shared_bytes, Stream& stream,
                   std::initializer_list<ParameterBytes> parameters, std::function<void()> thread) {
  ++TheMachine().num_launches;
  if (grid.x * grid.y == 0 || block.x * block.y == 0 || block.x * block.y > 1024) {
    emulation::Report("a launch of no block, no thread or too many threads");
  }
  for (const ParameterBytes& parameter : parameters) emulation::CheckParameter(parameter);
  const bool fails = std::exchange(TheMachine().fail_next_kernel, false);
  stream.queue.push_back([=, &stream] {
    if (fails) {
      stream.status = absl::UnavailableError("the device fell off the bus");
      return;
    }
    emulation::RunGrid(grid, block, shared_bytes, thread);
  });
}

absl::Status StreamSynchronize(Stream& stream) {
  emulation::Run(stream);
  return stream.status;
}

double ElapsedSeconds(int from, int to, const Stream& stream) {
  return std::chrono::duration<double>(stream.marks[static_cast<std::size_t>(to)] -
                                       stream.marks[static_cast<std::size_t>(from)])
      .count();
}

}  // namespace gem::gpu
