#include "client/retry_thread.h"

#include <algorithm>
#include <chrono>
#include <random>
#include <utility>

namespace gem::client {
namespace {

/// A server must not put its clients to sleep for good.
constexpr double kRetryAfter_sMax = 3600;

}  // namespace

bool Interrupt::Arm(std::function<void()> wake) {
  MutexLock lock(mutex_);
  if (raised_) return false;
  wake_ = std::move(wake);
  return true;
}

void Interrupt::Disarm() {
  MutexLock lock(mutex_);
  wake_ = nullptr;
}

bool Interrupt::raised() const {
  MutexLock lock(mutex_);
  return raised_;
}

void Interrupt::Raise() {
  MutexLock lock(mutex_);
  raised_ = true;
  // Under the lock, so that what it wakes is still there.
  if (wake_) wake_();
  wake_ = nullptr;
  changed_.NotifyAll();
}

bool Interrupt::SleepFor(double seconds) {
  const auto until = std::chrono::steady_clock::now() +
                     std::chrono::duration_cast<std::chrono::steady_clock::duration>(
                         std::chrono::duration<double>(seconds));
  MutexLock lock(mutex_);
  while (!raised_ && changed_.WaitUntil(mutex_, until)) {
  }
  return raised_;
}

RetryThread::RetryThread(const RetryOptions& options, Try attempt)
    : options_(options), attempt_(std::move(attempt)), thread_([this] { Run(); }) {}

RetryThread::~RetryThread() {
  interrupt_.Raise();
  thread_.join();
}

void RetryThread::Run() {
  // A fleet that lost its server together does not come back together.
  std::minstd_rand random(std::random_device{}());
  std::uniform_real_distribution<double> jitter(0.5, 1);
  double pause_s = options_.backoff_s_min;
  while (!interrupt_.raised()) {
    const Outcome outcome = attempt_(interrupt_);
    if (outcome.final) return;
    if (outcome.progressed) pause_s = options_.backoff_s_min;
    const double asked_s = std::min(outcome.retry_after_s.value_or(0), kRetryAfter_sMax);
    if (interrupt_.SleepFor(std::max(pause_s * jitter(random), asked_s))) return;
    pause_s = std::min(2 * pause_s, options_.backoff_s_max);
  }
}

}  // namespace gem::client
