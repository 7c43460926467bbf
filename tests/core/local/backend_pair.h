// The cpu and the cuda backend side by side, fed alike and compared to the last bit. Whether cuda
// is a device or its emulation is for the target to say that includes this.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "core/local/cpu_mapper.h"
#include "core/local/cuda/cuda_mapper.h"
#include "tests/core/local/compare_maps.h"

namespace gem::testing {

/// Has the emulation run threads in another order from now on. A device does as it likes anyway.
void ShuffleThreads(unsigned seed);

/// 23 cells a side: no multiple of a block.
inline LocalMapOptions SmallWindow() {
  LocalMapOptions options;
  options.side_m = 4.6f;
  return options;
}

/// The first difference in words, or ""; to the last bit, unlike compare_maps.h.
inline std::string BitDifferenceOf(const LocalMap& cpu, const LocalMap& cuda) {
  const std::string difference = DifferenceOf(cpu, cuda);
  if (!difference.empty()) return difference;
  if (cpu.slope_rad != cuda.slope_rad) return "slopes differ in their last bits";
  if (cpu.roughness_m != cuda.roughness_m) return "roughness differs in its last bits";
  if (cpu.traversability != cuda.traversability) return "traversability differs in its last bits";
  return "";
}

inline std::string DifferenceOfEvicted(const std::vector<EvictedCell>& cpu,
                                       const std::vector<EvictedCell>& cuda) {
  if (cpu.size() != cuda.size()) return "evicted counts differ";
  for (std::size_t i = 0; i < cpu.size(); ++i) {
    if (cpu[i].cell != cuda[i].cell || cpu[i].belief != cuda[i].belief)
      return absl::StrCat("evicted cell ", i, " differs");
  }
  return "";
}

/// One of each.
class Pair {
 public:
  explicit Pair(const LocalMapOptions& options)
      : cpu_(MakeCpuMapper(options, 1)), cuda_(*MakeCudaMapper(options)) {}

  /// Fuses the scan into both; the first difference in words, or "".
  std::string Fuse(const Scan& scan) {
    cpu_evicted_.clear();
    cuda_evicted_.clear();
    report_ = cpu_->FuseScan(scan, cpu_evicted_);
    const ScanReport cuda_report = cuda_->FuseScan(scan, cuda_evicted_);
    cleared_ += report_.cells_cleared;
    restarted_ += report_.cells_restarted;
    evicted_ += report_.cells_evicted;
    std::string difference = DifferenceOf(report_, cuda_report);
    if (difference.empty()) difference = DifferenceOfEvicted(cpu_evicted_, cuda_evicted_);
    if (difference.empty()) difference = DifferenceOfMaps();
    return difference;
  }
  std::string EvictAll() {
    cpu_evicted_.clear();
    cuda_evicted_.clear();
    cpu_->EvictAll(cpu_evicted_);
    cuda_->EvictAll(cuda_evicted_);
    std::string difference = DifferenceOfEvicted(cpu_evicted_, cuda_evicted_);
    return difference.empty() ? DifferenceOfMaps() : difference;
  }

  std::uint64_t cleared() const { return cleared_; }
  std::uint64_t restarted() const { return restarted_; }
  std::uint64_t evicted() const { return evicted_; }

 private:
  std::string DifferenceOfMaps() {
    cpu_->CopyTo(cpu_map_);
    cuda_->CopyTo(cuda_map_);
    return BitDifferenceOf(cpu_map_, cuda_map_);
  }

  std::unique_ptr<LocalMapper> cpu_, cuda_;
  std::vector<EvictedCell> cpu_evicted_, cuda_evicted_;
  LocalMap cpu_map_, cuda_map_;
  ScanReport report_;
  std::uint64_t cleared_ = 0, restarted_ = 0, evicted_ = 0;
};

}  // namespace gem::testing
