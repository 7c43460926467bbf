// Fibers on ucontext that AddressSanitizer and ThreadSanitizer understand. ThreadSanitizer takes
// each for a thread of its own and is told of no order between them but barriers.
#pragma once

#include <ucontext.h>

#include <cstddef>
#include <deque>
#include <functional>

namespace gem::gpu::emulation {

/// Fibers that are used again and again; the caller of Resume schedules them.
class FiberPool {
 public:
  /// At least `count` fibers.
  void Grow(std::size_t count);

  /// Runs a fiber until it yields or its body returns; true if it returned. A fiber whose body
  /// returned begins anew. The body is the same for all.
  bool Resume(std::size_t fiber, const std::function<void()>& body);

  /// Of the running fiber: back to the caller of Resume.
  void Yield();

  bool in_fiber() const { return running_ != nullptr; }

 private:
  struct Fiber {
    ucontext_t context;
    void* stack = nullptr;
    void* fake_stack = nullptr;  // of AddressSanitizer
    void* tsan_fiber = nullptr;  // of ThreadSanitizer
    bool ended = true;
  };

  static void Main();
  static void Begin(Fiber& fiber);
  void SwitchToScheduler();

  std::deque<Fiber> fibers_;
  Fiber scheduler_;
  const void* scheduler_stack_ = nullptr;
  std::size_t scheduler_stack_bytes_ = 0;
  Fiber* running_ = nullptr;
  const std::function<void()>* body_ = nullptr;
};

/// What all threads of a block did before a barrier comes before what they do after it.
void ReleaseTo(void* barrier);
void AcquireFrom(void* barrier);

}  // namespace gem::gpu::emulation
