#include "core/base/thread_team.h"

#include <chrono>

#include "core/base/check.h"

namespace gem {
namespace {

// A round is counted above the bit that wakes those who sleep.
constexpr int kAlarmBits = 1;
constexpr std::uint32_t kAlarm = 1, kRound = 1u << kAlarmBits;

// Waking a thread takes tens of microseconds, so one that waits first looks again for somewhat
// longer; then it sleeps, as the next scan is far away.
constexpr std::chrono::microseconds kSpin(100);
constexpr int kLooks = 64;  // between two looks at the clock

void Pause() {
#if defined(__x86_64__)
  __builtin_ia32_pause();
#endif
}

// Returns once the value, without its lowest bits, differs from `old`. A change of these ends sleep
// and begins a new spin.
void WaitForChange(const std::atomic<std::uint32_t>& value, std::uint32_t old, int ignored_bits) {
  for (;;) {
    std::uint32_t now = old;
    const auto until = std::chrono::steady_clock::now() + kSpin;
    do {
      for (int i = 0; i < kLooks; ++i) {
        now = value.load(std::memory_order_acquire);
        if ((now >> ignored_bits) != (old >> ignored_bits)) return;
        Pause();
      }
    } while (std::chrono::steady_clock::now() < until);
    value.wait(now, std::memory_order_acquire);
  }
}

}  // namespace

ThreadTeam::ThreadTeam(int size) {
  GEM_CHECK(size >= 1);
  threads_.reserve(static_cast<std::size_t>(size - 1));
  for (int i = 1; i < size; ++i) threads_.emplace_back([this, i] { Serve(i); });
}

ThreadTeam::~ThreadTeam() {
  call_ = nullptr;
  round_.fetch_add(kRound, std::memory_order_release);
  round_.notify_all();
}

void ThreadTeam::Wake() {
  if (threads_.empty()) return;
  round_.fetch_xor(kAlarm, std::memory_order_release);
  round_.notify_all();
}

void ThreadTeam::RunErased(Erased call, const void* work) {
  if (threads_.empty()) return call(work, 0);
  call_ = call;
  work_ = work;
  num_busy_.store(static_cast<std::uint32_t>(threads_.size()), std::memory_order_relaxed);
  round_.fetch_add(kRound, std::memory_order_release);
  round_.notify_all();
  call(work, 0);
  for (std::uint32_t busy = num_busy_.load(std::memory_order_acquire); busy != 0;
       busy = num_busy_.load(std::memory_order_acquire)) {
    WaitForChange(num_busy_, busy, 0);
  }
}

void ThreadTeam::Serve(int i) {
  for (std::uint32_t round = 0;; round += kRound) {
    WaitForChange(round_, round, kAlarmBits);
    if (call_ == nullptr) return;
    call_(work_, i);
    num_busy_.fetch_sub(1, std::memory_order_release);
    num_busy_.notify_all();
  }
}

}  // namespace gem
