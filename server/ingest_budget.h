// How many bytes of scans and poses may wait for all sessions together, and what of that one
// session may have. Knows no session. Thread-safe.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstdint>

namespace gem {

class IngestBudget {
 public:
  /// A session may always have `floor_bytes`, however little is left: then one that behaves is
  /// never shut out by those that do not. What waits is at most bytes_max and that for each
  /// session.
  IngestBudget(std::uint64_t bytes_max, std::uint64_t floor_bytes)
      : bytes_max_(bytes_max), floor_bytes_(floor_bytes) {}

  void Take(std::uint64_t bytes) { used_bytes_.fetch_add(bytes, std::memory_order_relaxed); }
  void GiveBack(std::uint64_t bytes) { used_bytes_.fetch_sub(bytes, std::memory_order_relaxed); }

  /// What one session may have now: as much as nobody uses. So n sessions that take all they can
  /// get settle at a (n + 1)th each, and leave the same to whoever comes next.
  std::uint64_t share_bytes() const {
    const std::uint64_t used_bytes = this->used_bytes();
    return std::max(floor_bytes_, bytes_max_ - std::min(bytes_max_, used_bytes));
  }
  std::uint64_t used_bytes() const { return used_bytes_.load(std::memory_order_relaxed); }

 private:
  // Constant after construction.
  const std::uint64_t bytes_max_;
  const std::uint64_t floor_bytes_;

  std::atomic<std::uint64_t> used_bytes_{0};
};

}  // namespace gem
