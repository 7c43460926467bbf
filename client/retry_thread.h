// A thread that tries something again and again, with pauses that grow, until it is stopped or no
// further try can help: how watches outlive their connections. Knows nothing of connections.
#pragma once

#include <functional>
#include <optional>
#include <thread>

#include "absl/status/status.h"
#include "core/base/mutex.h"

namespace gem::client {

/// How a try that blocks is made to end.
class Interrupt {
 public:
  /// `wake` is called once, from another thread, if the try is to end. False: it is to end already.
  bool Arm(std::function<void()> wake);
  /// After it, `wake` is not called any more, and no call of it is in progress.
  void Disarm();
  bool raised() const;

 private:
  friend class RetryThread;
  void Raise();
  /// Returns true if it was raised.
  bool SleepFor(double seconds);

  mutable Mutex mutex_;
  CondVar changed_;
  std::function<void()> wake_ ABSL_GUARDED_BY(mutex_);
  bool raised_ ABSL_GUARDED_BY(mutex_) = false;
};

struct RetryOptions {
  /// First pause, seconds; doubles with each try that got nowhere. Range (0, backoff_s_max].
  double backoff_s_min = 0.1;
  double backoff_s_max = 5;
};

class RetryThread {
 public:
  /// What became of a try.
  struct Outcome {
    absl::Status status;      ///< why it ended
    bool progressed = false;  ///< it worked for a while: pauses begin anew
    bool final = false;       ///< no further try can help
    std::optional<double> retry_after_s = std::nullopt;  ///< the next pause is not shorter
  };
  using Try = std::function<Outcome(Interrupt& interrupt)>;

  /// `attempt` runs on the thread.
  RetryThread(const RetryOptions& options, Try attempt);
  /// Raises the interrupt and joins the thread.
  ~RetryThread();
  RetryThread(const RetryThread&) = delete;
  RetryThread& operator=(const RetryThread&) = delete;

 private:
  void Run();

  const RetryOptions options_;
  const Try attempt_;
  Interrupt interrupt_;
  std::thread thread_;
};

}  // namespace gem::client
