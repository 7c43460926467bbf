// What is known of a watch that goes on over several streams, and the wait for its next news. Knows
// nothing of connections; shared by MapMirror and LocalMapSubscriber.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <optional>

#include "absl/status/status.h"
#include "core/base/mutex.h"

namespace gem::client {

struct WatchStats {
  bool connected = false;            ///< the server has answered on the stream that is open
  bool ended = false;                ///< no further try is made; `error` says why
  absl::Status error;                ///< why the last stream ended; OK while none has
  std::uint64_t num_reconnects = 0;  ///< streams on which the server answered, the first not
  std::uint64_t received_bytes = 0;  ///< messages
  /// For how long what is held is known to be behind, seconds: since the stream broke, or since
  /// the first part of a change came that is not complete. 0: it is not.
  double lag_s = 0;
};

/// Thread-safe.
class WatchState {
 public:
  // By the thread that watches.
  /// A message came. more_due: it is a part, and what is held is behind until the rest has come.
  void Receive(std::size_t bytes, bool first_of_stream, bool more_due);
  /// The stream broke, or could not be opened.
  void Break(const absl::Status& why, bool final);
  /// There is something new for those who wait.
  void Notify();

  WatchStats stats() const;

  /// Returns when there() is true. DEADLINE_EXCEEDED after timeout_s, with the watch's error if it
  /// has one; if the watch has ended, what ended it. there() is called under a lock of this
  /// class and must not use it.
  absl::Status WaitUntil(const std::function<bool()>& there, double timeout_s) const;

 private:
  using Clock = std::chrono::steady_clock;

  mutable Mutex mutex_;
  mutable CondVar changed_;
  WatchStats stats_ ABSL_GUARDED_BY(mutex_);  ///< lag_s is not kept here
  bool answered_before_ ABSL_GUARDED_BY(mutex_) = false;
  std::optional<Clock::time_point> behind_since_ ABSL_GUARDED_BY(mutex_) = Clock::now();
};

}  // namespace gem::client
