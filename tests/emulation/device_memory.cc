#include "tests/emulation/device_memory.h"

#include <signal.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cstring>
#include <map>

#include "core/base/check.h"
#include "tests/emulation/emulation.h"

namespace gem::gpu::emulation {
namespace {

constexpr std::size_t kPageBytes = 4096;
constexpr std::size_t kRangeBytes = std::size_t{8} << 30;  // of addresses, not of memory
constexpr std::size_t kSharedBytesMax = 48 * 1024;
/// What device pointers are aligned to here; real ones are to more.
constexpr std::size_t kAlignment = 16;

std::size_t RoundUp(std::size_t value, std::size_t unit) {
  return (value + unit - 1) / unit * unit;
}

struct Allocation {
  unsigned char* pages;
  std::size_t pages_bytes;
  std::size_t size_bytes;
};

class Range {
 public:
  Range() {
    void* memory =
        mmap(nullptr, kRangeBytes, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
    GEM_CHECK(memory != MAP_FAILED);
    begin_ = static_cast<unsigned char*>(memory);
    shared_ = begin_ + kPageBytes;
    GEM_CHECK(mprotect(shared_, kSharedBytesMax, PROT_READ | PROT_WRITE) == 0);
    next_ = shared_ + kSharedBytesMax + kPageBytes;
  }

  bool Contains(const void* memory) const {
    return memory >= begin_ && memory < begin_ + kRangeBytes;
  }

  bool IsShared(std::uintptr_t address) const {
    return address - reinterpret_cast<std::uintptr_t>(shared_) < kSharedBytesMax;
  }

  void* Allocate(std::size_t size_bytes) {
    const std::size_t pages_bytes = RoundUp(size_bytes + kAlignment, kPageBytes);
    if (size_bytes > kRangeBytes || next_ + pages_bytes + kPageBytes > begin_ + kRangeBytes)
      return nullptr;
    const Allocation allocation{next_, pages_bytes, size_bytes};
    next_ += pages_bytes + kPageBytes;
    Protect(allocation, PROT_READ | PROT_WRITE);
    std::memset(allocation.pages, kPoison, pages_bytes);
    if (!open_) Protect(allocation, PROT_NONE);
    // The end lies at the page that is not there.
    unsigned char* data = allocation.pages + pages_bytes - RoundUp(size_bytes, kAlignment);
    allocations_[data] = allocation;
    return data;
  }

  void Free(void* memory) {
    const auto found = allocations_.find(static_cast<unsigned char*>(memory));
    if (found == allocations_.end()) Report("what is freed was not allocated on the device");
    munmap(found->second.pages, found->second.pages_bytes);
    mmap(found->second.pages, found->second.pages_bytes, PROT_NONE,
         MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE | MAP_FIXED, -1, 0);
    allocations_.erase(found);
  }

  void Open() {
    open_ = true;
    for (const auto& [data, allocation] : allocations_) Protect(allocation, PROT_READ | PROT_WRITE);
  }
  void Close() {
    open_ = false;
    for (const auto& [data, allocation] : allocations_) {
      CheckBorders(data, allocation);
      Protect(allocation, PROT_NONE);
    }
  }

  bool IsAllocated(const unsigned char* memory, std::size_t size_bytes) const {
    auto after = allocations_.upper_bound(const_cast<unsigned char*>(memory));
    if (after == allocations_.begin()) return false;
    --after;
    return memory + size_bytes <= after->first + after->second.size_bytes;
  }

  void* PoisonShared(std::size_t size_bytes) {
    if (size_bytes > kSharedBytesMax) Report("more than 48 KiB of shared memory");
#if defined(GEM_TSAN_FIBERS)
    // New memory, so that blocks which have it one after the other do not race for it.
    GEM_CHECK(mmap(shared_, kSharedBytesMax, PROT_READ | PROT_WRITE,
                   MAP_PRIVATE | MAP_ANONYMOUS | MAP_FIXED, -1, 0) == shared_);
#endif
    std::memset(shared_, kPoison, kSharedBytesMax);
    return shared_ + kSharedBytesMax - RoundUp(size_bytes, kAlignment);
  }

 private:
  static void Protect(const Allocation& allocation, int protection) {
    GEM_CHECK(mprotect(allocation.pages, allocation.pages_bytes, protection) == 0);
  }
  static void CheckBorders(const unsigned char* data, const Allocation& allocation) {
    for (const unsigned char* p = allocation.pages; p < data; ++p)
      if (*p != kPoison) Report("a kernel wrote before the begin of an allocation");
    const unsigned char* end = allocation.pages + allocation.pages_bytes;
    for (const unsigned char* p = data + allocation.size_bytes; p < end; ++p)
      if (*p != kPoison) Report("a kernel wrote behind the end of an allocation");
  }

  unsigned char* begin_;
  unsigned char* shared_;
  unsigned char* next_;
  bool open_ = false;
  std::map<unsigned char*, Allocation> allocations_;
};

Range& TheRange() {
  static Range* const range = new Range;
  return *range;
}

bool (*fault_in_kernel)() = nullptr;

void OnFault(int signal, siginfo_t* info, void*) {
  if (TheRange().Contains(info->si_addr)) {
    Report(fault_in_kernel() ? "a kernel touched memory out of bounds"
                             : "the host touched device memory");
  }
  ::signal(signal, SIG_DFL);  // happens again at once, and ends the process
}

}  // namespace

void* AllocateDevice(std::size_t size_bytes) { return TheRange().Allocate(size_bytes); }
void FreeDevice(void* memory) { TheRange().Free(memory); }
void OpenDevice() { TheRange().Open(); }
void CloseDevice() { TheRange().Close(); }
bool IsDevice(const void* memory, std::size_t size_bytes) {
  return TheRange().IsAllocated(static_cast<const unsigned char*>(memory), size_bytes);
}
void* PoisonShared(std::size_t size_bytes) { return TheRange().PoisonShared(size_bytes); }
bool IsShared(std::uintptr_t address) { return TheRange().IsShared(address); }
bool InDeviceRange(const void* memory) { return TheRange().Contains(memory); }

void InstallFaultHandler(bool (*in_kernel)()) {
  if (fault_in_kernel != nullptr) return;
  fault_in_kernel = in_kernel;
  TheRange();
  // A stack of its own: that of the fiber may be what overflowed.
  static unsigned char stack[64 * 1024];
  const stack_t alternative{.ss_sp = stack, .ss_flags = 0, .ss_size = sizeof(stack)};
  GEM_CHECK(sigaltstack(&alternative, nullptr) == 0);
  struct sigaction action = {};
  action.sa_sigaction = &OnFault;
  action.sa_flags = SA_SIGINFO | SA_ONSTACK;
  GEM_CHECK(sigaction(SIGSEGV, &action, nullptr) == 0);
}

void Report(const char* what) {
  static_cast<void>(!write(STDERR_FILENO, "emulation: ", 11));
  static_cast<void>(!write(STDERR_FILENO, what, std::strlen(what)));
  static_cast<void>(!write(STDERR_FILENO, "\n", 1));
  std::abort();
}

}  // namespace gem::gpu::emulation
