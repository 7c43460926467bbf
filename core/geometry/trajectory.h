// Poses over time, looked up by interpolation.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "core/base/check.h"
#include "core/geometry/pose.h"

namespace gem {

template <typename A, typename B>
struct StampedPose {
  std::int64_t stamp_ns = 0;
  Pose<A, B> T_A_B;
};

/// T_A_B over time. Stamps increase strictly. Not thread-safe.
template <typename A, typename B>
class Trajectory {
 public:
  bool empty() const { return poses_.empty(); }
  std::size_t size() const { return poses_.size(); }
  const StampedPose<A, B>& front() const { return poses_.front(); }
  const StampedPose<A, B>& back() const { return poses_.back(); }
  const std::vector<StampedPose<A, B>>& poses() const { return poses_; }

  /// The caller has checked that stamp_ns is newer than the newest.
  void Append(std::int64_t stamp_ns, const Pose<A, B>& T_A_B) {
    GEM_CHECK(empty() || stamp_ns > back().stamp_ns);
    poses_.push_back({stamp_ns, T_A_B});
  }

  /// Puts the newest pose at a later stamp: the same place, seen for longer.
  void MoveBack(std::int64_t stamp_ns) {
    GEM_CHECK(!empty() && stamp_ns > back().stamp_ns);
    poses_.back().stamp_ns = stamp_ns;
  }

  /// Forgets the oldest poses until at most size_max are left.
  void DropOldest(std::size_t size_max) {
    if (poses_.size() <= size_max) return;
    poses_.erase(poses_.begin(), poses_.end() - static_cast<std::ptrdiff_t>(size_max));
  }

  /// Keeps every second pose of the older half, the first among them.
  void ThinOlderHalf() {
    const std::size_t half = poses_.size() / 2;
    std::size_t kept = 0;
    for (std::size_t i = 0; i < poses_.size(); ++i) {
      if (i < half && i % 2 == 1) continue;
      poses_[kept++] = poses_[i];
    }
    poses_.resize(kept);
  }

  /// Nothing outside [front, back]: extrapolation is the caller's decision.
  std::optional<Pose<A, B>> At(std::int64_t stamp_ns) const {
    const auto next =
        std::lower_bound(poses_.begin(), poses_.end(), stamp_ns,
                         [](const StampedPose<A, B>& p, std::int64_t t) { return p.stamp_ns < t; });
    if (next == poses_.end()) return std::nullopt;
    if (next->stamp_ns == stamp_ns) return next->T_A_B;
    if (next == poses_.begin()) return std::nullopt;
    const StampedPose<A, B>& before = *(next - 1);
    const double fraction = static_cast<double>(stamp_ns - before.stamp_ns) /
                            static_cast<double>(next->stamp_ns - before.stamp_ns);
    return Interpolate(before.T_A_B, next->T_A_B, fraction);
  }

 private:
  std::vector<StampedPose<A, B>> poses_;
};

}  // namespace gem
