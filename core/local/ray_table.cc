#include "core/local/ray_table.h"

namespace gem {
namespace {

void LowerAll(float* __restrict slopes, const float* __restrict by, std::size_t count) {
  for (std::size_t i = 0; i < count; ++i) slopes[i] = by[i] < slopes[i] ? by[i] : slopes[i];
}

}  // namespace

void RayTable::Complete(VectorSet set, const AzimuthSector& sector) {
  RunVectorised(set, [&] {
    for (std::int32_t range_bin = limit_ - 1; range_bin >= 0; --range_bin) {
      LowerAll(&slopes_[IndexAt(range_bin, sector.begin)],
               &slopes_[IndexAt(range_bin + 1, sector.begin)], sector.size());
    }
  });
}

bool RayTable::AllPassBelow(const CellSight& sight, float sensor_z_m, float height_m) const {
  if (sight.num_bins == 0 || sight.range_bin_min > limit_) return false;
  bool crossed = false;
  for (std::int32_t i = 0; i < sight.num_bins; ++i) {
    const std::int32_t unwrapped = sight.first_bin + i;
    const std::int32_t bin = unwrapped < bins_.azimuth ? unwrapped : unwrapped - bins_.azimuth;
    if (!NonePassesAbove(sight, bin, sensor_z_m, height_m)) return false;
    crossed = crossed || slopes_[IndexAt(0, bin)] != kNoRay;
  }
  return crossed;
}

}  // namespace gem
