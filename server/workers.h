// The server's pools of threads, by what must not wait for what.
#pragma once

#include "server/options.h"
#include "server/worker_pool.h"

namespace gem {

struct Workers {
  explicit Workers(const ServerOptions& options)
      : reads(options.worker_threads, options.worker_queue_max),
        corrections(kCorrectionThreads, options.worker_queue_max),
        admin(options.admin_threads, options.worker_queue_max) {}

  /// Runs what still waits and ends the threads.
  void Stop() {
    reads.Stop();
    corrections.Stop();
    admin.Stop();
  }

  /// Encoding for readers, and all else that is short.
  WorkerPool reads;
  /// Conversion of corrections: however many readers ask, none waits behind them or is refused for
  /// them.
  WorkerPool corrections;
  /// What waits for threads.
  WorkerPool admin;

 private:
  /// Reading poses is little beside what the map's thread then does with them.
  static constexpr int kCorrectionThreads = 1;
};

}  // namespace gem
