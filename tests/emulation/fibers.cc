#include "tests/emulation/fibers.h"

#include <sys/mman.h>

#include "core/base/check.h"

#if defined(__has_feature)
#if __has_feature(address_sanitizer)
#define GEM_ASAN 1
#endif
#if __has_feature(thread_sanitizer) || defined(GEM_TSAN_FIBERS)
#define GEM_TSAN 1
#endif
#endif
#if defined(__SANITIZE_ADDRESS__)
#define GEM_ASAN 1
#endif

#if defined(GEM_ASAN)
#include <sanitizer/common_interface_defs.h>
#endif
#if defined(GEM_TSAN)
#include <sanitizer/tsan_interface.h>
#endif

namespace gem::gpu::emulation {
namespace {

// Sanitizers make frames large.
constexpr std::size_t kStackBytes = 256 * 1024;
constexpr std::size_t kGuardBytes = 4096;

FiberPool* starting_pool = nullptr;

void BeginSwitch(void** own_fake_stack, const void* to_stack, std::size_t to_bytes) {
#if defined(GEM_ASAN)
  __sanitizer_start_switch_fiber(own_fake_stack, to_stack, to_bytes);
#else
  static_cast<void>(own_fake_stack), static_cast<void>(to_stack), static_cast<void>(to_bytes);
#endif
}
void EndSwitch(void* own_fake_stack, const void** from_stack, std::size_t* from_bytes) {
#if defined(GEM_ASAN)
  __sanitizer_finish_switch_fiber(own_fake_stack, from_stack, from_bytes);
#else
  static_cast<void>(own_fake_stack), static_cast<void>(from_stack), static_cast<void>(from_bytes);
#endif
}
void SwitchTsan(void* fiber) {
#if defined(GEM_TSAN)
  __tsan_switch_to_fiber(fiber, __tsan_switch_to_fiber_no_sync);
#else
  static_cast<void>(fiber);
#endif
}
void* MakeTsanFiber() {
#if defined(GEM_TSAN)
  return __tsan_create_fiber(0);
#else
  return nullptr;
#endif
}
void* ThisTsanFiber() {
#if defined(GEM_TSAN)
  return __tsan_get_current_fiber();
#else
  return nullptr;
#endif
}

}  // namespace

void FiberPool::Begin(Fiber& fiber) {
  GEM_CHECK(getcontext(&fiber.context) == 0);
  fiber.context.uc_stack.ss_sp = fiber.stack;
  fiber.context.uc_stack.ss_size = kStackBytes;
  fiber.context.uc_link = nullptr;
  makecontext(&fiber.context, &FiberPool::Main, 0);
}

void FiberPool::Grow(std::size_t count) {
  while (fibers_.size() < count) {
    Fiber& fiber = fibers_.emplace_back();
    void* memory = mmap(nullptr, kGuardBytes + kStackBytes, PROT_READ | PROT_WRITE,
                        MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
    GEM_CHECK(memory != MAP_FAILED);
    GEM_CHECK(mprotect(memory, kGuardBytes, PROT_NONE) == 0);
    fiber.stack = static_cast<char*>(memory) + kGuardBytes;
    fiber.tsan_fiber = MakeTsanFiber();
    Begin(fiber);
  }
}

// Never returns: when a body ends, the fiber waits for the next.
void FiberPool::Main() {
  FiberPool& pool = *starting_pool;
  EndSwitch(nullptr, &pool.scheduler_stack_, &pool.scheduler_stack_bytes_);
  while (true) {
    (*pool.body_)();
    pool.running_->ended = true;
    pool.SwitchToScheduler();
  }
}

bool FiberPool::Resume(std::size_t index, const std::function<void()>& body) {
  Fiber& fiber = fibers_[index];
  fiber.ended = false;
  running_ = &fiber;
  body_ = &body;
  starting_pool = this;
  scheduler_.tsan_fiber = ThisTsanFiber();
  BeginSwitch(&scheduler_.fake_stack, fiber.stack, kStackBytes);
  SwitchTsan(fiber.tsan_fiber);
  swapcontext(&scheduler_.context, &fiber.context);
  EndSwitch(scheduler_.fake_stack, nullptr, nullptr);
  running_ = nullptr;
  return fiber.ended;
}

void FiberPool::Yield() { SwitchToScheduler(); }

void FiberPool::SwitchToScheduler() {
  Fiber& fiber = *running_;
  BeginSwitch(&fiber.fake_stack, scheduler_stack_, scheduler_stack_bytes_);
  SwitchTsan(scheduler_.tsan_fiber);
  swapcontext(&fiber.context, &scheduler_.context);
  EndSwitch(fiber.fake_stack, &scheduler_stack_, &scheduler_stack_bytes_);
}

void ReleaseTo(void* barrier) {
#if defined(GEM_TSAN)
  __tsan_release(barrier);
#else
  static_cast<void>(barrier);
#endif
}
void AcquireFrom(void* barrier) {
#if defined(GEM_TSAN)
  __tsan_acquire(barrier);
#else
  static_cast<void>(barrier);
#endif
}

}  // namespace gem::gpu::emulation
