// Shows how far a stream of scans is: a bar that moves on a terminal, now and then a line
// elsewhere.
#pragma once

#include <chrono>
#include <cstdint>
#include <cstdio>
#include <string>

namespace gem::client {

struct Progress {
  std::uint64_t done = 0;
  std::uint64_t done_before = 0;  ///< part of done that an earlier run did, and that took no time
  std::uint64_t total = 0;
};

/// "kitti [=====>    ] 50/100  9.8 scans/s  ETA 5 s". The bar fills the line up to `width`.
std::string ProgressLine(const std::string& name, const Progress& progress, double elapsed_s,
                         std::size_t width);

/// Writes to stderr. Not thread-safe.
class ProgressBar {
 public:
  /// `progress` before the first scan of this run.
  ProgressBar(std::string name, const Progress& progress);
  /// Leaves the terminal on a new line.
  ~ProgressBar();
  ProgressBar(const ProgressBar&) = delete;
  ProgressBar& operator=(const ProgressBar&) = delete;

  void Show(std::uint64_t done);

 private:
  using Clock = std::chrono::steady_clock;

  const std::string name_;
  const bool terminal_;
  const Clock::time_point begin_;
  Progress progress_;
  Clock::time_point shown_;  // when the last line was written
  bool open_line_ = false;
};

}  // namespace gem::client
