#include "core/base/thread_team.h"

#include "core/base/check.h"

namespace gem {
namespace {

// Waking a thread takes tens of microseconds, so one that waits first looks again for about as
// long; then it sleeps, as the next scan is far away.
constexpr int kSpins = 4000;

void Pause() {
#if defined(__x86_64__)
  __builtin_ia32_pause();
#endif
}

// Returns once the value differs from `old`.
void WaitForChange(const std::atomic<std::uint32_t>& value, std::uint32_t old) {
  for (int i = 0; i < kSpins; ++i) {
    if (value.load(std::memory_order_acquire) != old) return;
    Pause();
  }
  value.wait(old, std::memory_order_acquire);
}

}  // namespace

ThreadTeam::ThreadTeam(int size) {
  GEM_CHECK(size >= 1);
  threads_.reserve(static_cast<std::size_t>(size - 1));
  for (int i = 1; i < size; ++i) threads_.emplace_back([this, i] { Serve(i); });
}

ThreadTeam::~ThreadTeam() {
  call_ = nullptr;
  round_.fetch_add(1, std::memory_order_release);
  round_.notify_all();
}

void ThreadTeam::RunErased(Erased call, const void* work) {
  if (threads_.empty()) return call(work, 0);
  call_ = call;
  work_ = work;
  num_busy_.store(static_cast<std::uint32_t>(threads_.size()), std::memory_order_relaxed);
  round_.fetch_add(1, std::memory_order_release);
  round_.notify_all();
  call(work, 0);
  for (std::uint32_t busy = num_busy_.load(std::memory_order_acquire); busy != 0;
       busy = num_busy_.load(std::memory_order_acquire)) {
    WaitForChange(num_busy_, busy);
  }
}

void ThreadTeam::Serve(int i) {
  for (std::uint32_t round = 0;; ++round) {
    WaitForChange(round_, round);
    if (call_ == nullptr) return;
    call_(work_, i);
    num_busy_.fetch_sub(1, std::memory_order_release);
    num_busy_.notify_all();
  }
}

}  // namespace gem
