#include "client/watch_state.h"

#include <algorithm>

#include "absl/strings/str_cat.h"

namespace gem::client {
namespace {

/// Waits longer than this are for ever; a time point must not overflow.
constexpr double kTimeout_sMax = 1e8;

}  // namespace

void WatchState::Receive(std::size_t bytes, bool first_of_stream, bool more_due) {
  MutexLock lock(mutex_);
  stats_.received_bytes += bytes;
  stats_.connected = true;
  if (first_of_stream && answered_before_) ++stats_.num_reconnects;
  answered_before_ = true;
  if (!more_due) {
    behind_since_.reset();
  } else if (!behind_since_) {
    behind_since_ = Clock::now();
  }
}

void WatchState::Break(const absl::Status& why, bool final) {
  MutexLock lock(mutex_);
  stats_.connected = false;
  stats_.ended = final;
  stats_.error = why;
  if (!behind_since_) behind_since_ = Clock::now();
  changed_.NotifyAll();
}

void WatchState::Notify() {
  MutexLock lock(mutex_);
  changed_.NotifyAll();
}

WatchStats WatchState::stats() const {
  MutexLock lock(mutex_);
  WatchStats stats = stats_;
  if (behind_since_)
    stats.lag_s = std::chrono::duration<double>(Clock::now() - *behind_since_).count();
  return stats;
}

absl::Status WatchState::WaitUntil(const std::function<bool()>& there, double timeout_s) const {
  const auto deadline =
      Clock::now() + std::chrono::duration_cast<Clock::duration>(
                         std::chrono::duration<double>(std::clamp(timeout_s, 0.0, kTimeout_sMax)));
  MutexLock lock(mutex_);
  while (!there()) {
    if (stats_.ended) return stats_.error;
    if (changed_.WaitUntil(mutex_, deadline) || there()) continue;
    // Why an earlier stream broke means nothing any more once the server answers.
    const bool reached = stats_.connected || stats_.error.ok();
    return absl::DeadlineExceededError(
        absl::StrCat("nothing new within ", timeout_s, " s",
                     reached ? std::string() : absl::StrCat("; ", stats_.error.ToString())));
  }
  return absl::OkStatus();
}

}  // namespace gem::client
