#include "server/worker_pool.h"

#include <utility>

#include "absl/strings/str_cat.h"
#include "core/base/thread_name.h"
#include "server/retry.h"

namespace gem {
namespace {

constexpr double kRetryAfter_s = 0.1;

}  // namespace

WorkerPool::WorkerPool(int threads, int queue_max)
    : queue_max_(static_cast<std::size_t>(queue_max)) {
  for (int i = 0; i < threads; ++i) threads_.emplace_back([this] { Run(); });
}

WorkerPool::~WorkerPool() { Stop(); }

absl::Status WorkerPool::Submit(std::function<void()> work) {
  MutexLock lock(mutex_);
  if (stopped_) return absl::UnavailableError("the server is going away");
  if (queue_.size() >= queue_max_)
    return WithRetry(absl::ResourceExhaustedError(
                         absl::StrCat(queue_.size(), " requests wait, want at most ", queue_max_)),
                     kRetryAfter_s);
  queue_.push_back(std::move(work));
  changed_.NotifyOne();
  return absl::OkStatus();
}

void WorkerPool::Stop() {
  {
    MutexLock lock(mutex_);
    stopped_ = true;
    changed_.NotifyAll();
  }
  for (std::thread& thread : threads_) thread.join();
  threads_.clear();
}

void WorkerPool::Run() {
  NameThread("worker");
  while (true) {
    std::function<void()> work;
    {
      MutexLock lock(mutex_);
      while (!stopped_ && queue_.empty()) changed_.Wait(mutex_);
      if (queue_.empty()) return;
      work = std::move(queue_.front());
      queue_.pop_front();
    }
    work();
  }
}

}  // namespace gem
