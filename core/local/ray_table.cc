#include "core/local/ray_table.h"

namespace gem {
namespace {

void LowerAll(float* __restrict slopes, const float* __restrict by, std::size_t count) {
  for (std::size_t i = 0; i < count; ++i) slopes[i] = by[i] < slopes[i] ? by[i] : slopes[i];
}

}  // namespace

void RayTable::Merge(VectorSet set, const RayTable& other) {
  GEM_CHECK(other.limit_ == limit_ && other.slopes_.size() == slopes_.size());
  RunVectorised(set,
                [&] { LowerAll(slopes_.data(), other.slopes_.data(), IndexAt(limit_ + 1, 0)); });
}

void RayTable::Complete(VectorSet set) {
  RunVectorised(set, [&] {
    const auto azimuth_bins = static_cast<std::size_t>(bins_.azimuth);
    for (std::int32_t range_bin = limit_ - 1; range_bin >= 0; --range_bin) {
      LowerAll(&slopes_[IndexAt(range_bin, 0)], &slopes_[IndexAt(range_bin + 1, 0)], azimuth_bins);
    }
  });
}

bool RayTable::AllPassBelow(const CellSight& sight, float sensor_z_m, float height_m) const {
  if (sight.num_bins == 0 || sight.range_bin_min > limit_) return false;
  const float* crossing = &slopes_[IndexAt(sight.range_bin_min, 0)];
  bool crossed = false;
  for (std::int32_t i = 0; i < sight.num_bins; ++i) {
    const std::int32_t unwrapped = sight.first_bin + i;
    const std::int32_t bin = unwrapped < bins_.azimuth ? unwrapped : unwrapped - bins_.azimuth;
    if (slopes_[IndexAt(0, bin)] == kNoRay) continue;
    if (crossing[bin] == kNoRay) return false;
    if (!(RayTopOver(sight, crossing[bin], sensor_z_m) < height_m)) return false;
    crossed = true;
  }
  return crossed;
}

}  // namespace gem
