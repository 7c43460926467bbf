// The lowest ray that ends beyond a distance in a direction: one pass over the rays of a scan fills
// it, one pass over the table completes it, and each cell then takes a look-up per azimuth bin.
#pragma once

#include <cstddef>
#include <vector>

#include "core/local/clear.h"

namespace gem {

class RayTable {
 public:
  explicit RayTable(const RayBins& bins)
      : bins_(bins),
        slopes_(static_cast<std::size_t>(bins.azimuth) * static_cast<std::size_t>(bins.range)) {}

  const RayBins& bins() const { return bins_; }

  /// Forgets all rays. Cells whose range_bin_min is above the limit will not be asked for, so rays
  /// that end later are kept as if they ended there. 1 <= limit < bins().range.
  void Reset(std::int32_t range_bin_limit);

  /// The ray to (x, y, z), relative to the sensor, axes of O; `count` of them.
  void Add(const float* x_m, const float* y_m, const float* z_m, std::size_t count);

  /// To be called once, after the last Add: from here on a range bin holds the rays that end in it
  /// or later, and bin 0 all rays.
  void Complete();

  /// Whether in every azimuth bin of the cell that holds rays one crosses the cell and passes below
  /// height_m. A bin without any ray, finer than the sensor's columns, says nothing.
  bool AllPassBelow(const CellSight& sight, float sensor_z_m, float height_m) const;

 private:
  std::size_t IndexAt(std::int32_t range_bin, std::int32_t azimuth_bin) const {
    return static_cast<std::size_t>(range_bin) * static_cast<std::size_t>(bins_.azimuth) +
           static_cast<std::size_t>(azimuth_bin);
  }

  // Constant after construction.
  const RayBins bins_;

  std::int32_t limit_ = 1;
  // Lowest slope by range bin, then azimuth bin; infinity where there is no ray.
  std::vector<float> slopes_;
};

}  // namespace gem
