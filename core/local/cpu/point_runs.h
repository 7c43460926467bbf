// The points of a scan in runs, and which thread measures which.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/base/vector_set.h"
#include "core/local/measure.h"
#include "core/local/ray_table.h"
#include "core/sensor/scan.h"

namespace gem::cpu {

/// Points [begin, end) of a scan.
struct PointRun {
  std::uint32_t begin = 0, end = 0;
  std::uint32_t owner = 0;  ///< the thread that it is meant for
};

/// Each thread first takes the runs that are meant for it, and then what others have not begun: the
/// team is still waking up when the first one starts.
class PointRuns {
 public:
  static constexpr std::size_t kNone = ~std::size_t{0};

  explicit PointRuns(std::size_t threads) : shelves_(threads) {}

  /// Begins a scan. Sensors measure direction by direction or ring by ring, so a look at every
  /// 512th point tells well enough where the points go over from one sector to another: runs end
  /// there. sectors: by thread.
  void Plan(VectorSet set, const ScanFrame& frame, const Scan& scan, const RayBins& bins,
            std::span<const AzimuthSector> sectors);

  /// In the order of the points.
  std::span<const PointRun> runs() const { return runs_; }

  /// Number of a run that nobody has taken, or kNone. Threads may call it at once.
  std::size_t Take(std::size_t thread) {
    for (std::size_t k = 0; k < shelves_.size(); ++k) {
      Shelf& shelf = shelves_[(thread + k) % shelves_.size()];
      if (shelf.next.load(std::memory_order_relaxed) >= shelf.end) continue;
      const std::size_t at = shelf.next.fetch_add(1, std::memory_order_relaxed);
      if (at < shelf.end) return order_[at];
    }
    return kNone;
  }

 private:
  // Alone in its cache line, as all threads write it.
  struct alignas(64) Shelf {
    std::atomic<std::size_t> next{0};
    std::size_t end = 0;
  };

  void Look(VectorSet set, const ScanFrame& frame, const Scan& scan, const RayBins& bins);
  void Cut(std::size_t num_points, const RayBins& bins, std::span<const AzimuthSector> sectors);
  void Deal();

  std::vector<PointRun> runs_;
  std::vector<Shelf> shelves_;        // by thread: [next, end) of order_
  std::vector<std::uint32_t> order_;  // numbers of runs, by owner

  std::vector<float> x_m_, y_m_, azimuth_;  // of the points that were looked at
};

}  // namespace gem::cpu
