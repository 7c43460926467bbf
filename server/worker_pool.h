// A few threads for work that is too heavy for gRPC's callback threads, which all calls share:
// encoding tiles, converting long corrections. Bounded; whoever comes when it is full is told so.
#pragma once

#include <cstddef>
#include <deque>
#include <functional>
#include <thread>
#include <vector>

#include "absl/status/status.h"
#include "core/base/mutex.h"

namespace gem {

class WorkerPool {
 public:
  WorkerPool(int threads, int queue_max);
  ~WorkerPool();
  WorkerPool(const WorkerPool&) = delete;
  WorkerPool& operator=(const WorkerPool&) = delete;

  /// Runs `work` once on one of the threads. RESOURCE_EXHAUSTED, with when to retry, if too many
  /// wait; UNAVAILABLE once stopped. An error means that `work` never runs.
  absl::Status Submit(std::function<void()> work);

  /// Runs what still waits and ends the threads.
  void Stop();

 private:
  void Run();

  const std::size_t queue_max_;
  Mutex mutex_;
  CondVar changed_;
  std::deque<std::function<void()>> queue_ ABSL_GUARDED_BY(mutex_);
  bool stopped_ ABSL_GUARDED_BY(mutex_) = false;
  std::vector<std::thread> threads_;
};

}  // namespace gem
