#include "core/local/ray_table.h"

#include <algorithm>
#include <limits>

#include "core/base/check.h"

namespace gem {
namespace {

constexpr float kNoRay = std::numeric_limits<float>::infinity();

}  // namespace

void RayTable::Reset(std::int32_t range_bin_limit) {
  GEM_CHECK(range_bin_limit >= 1 && range_bin_limit < bins_.range);
  limit_ = range_bin_limit;
  std::fill_n(slopes_.begin(), IndexAt(limit_ + 1, 0), kNoRay);
}

void RayTable::Add(const float* x_m, const float* y_m, const float* z_m, std::size_t count) {
  // Few enough to stay in the first-level cache. Two loops, since only the first can be vectorised.
  constexpr std::size_t kBatch = 512;
  std::int32_t places[kBatch];
  float slopes[kBatch];
  for (std::size_t begin = 0; begin < count; begin += kBatch) {
    const std::size_t batch = std::min(kBatch, count - begin);
    for (std::size_t i = 0; i < batch; ++i) {
      const Ray ray = RayTo(x_m[begin + i], y_m[begin + i], z_m[begin + i], bins_);
      const std::int32_t range_bin = ray.range_bin < limit_ ? ray.range_bin : limit_;
      places[i] = range_bin * bins_.azimuth + ray.azimuth_bin;
      slopes[i] = ray.slope;
    }
    for (std::size_t i = 0; i < batch; ++i) {
      if (places[i] < bins_.azimuth) continue;  // range bin 0
      float& lowest = slopes_[static_cast<std::size_t>(places[i])];
      lowest = slopes[i] < lowest ? slopes[i] : lowest;
    }
  }
}

void RayTable::Complete() {
  for (std::int32_t range_bin = limit_ - 1; range_bin >= 0; --range_bin) {
    float* slopes = &slopes_[IndexAt(range_bin, 0)];
    const float* beyond = &slopes_[IndexAt(range_bin + 1, 0)];
    for (std::int32_t azimuth_bin = 0; azimuth_bin < bins_.azimuth; ++azimuth_bin) {
      slopes[azimuth_bin] = std::min(slopes[azimuth_bin], beyond[azimuth_bin]);
    }
  }
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
