// The lowest ray that ends beyond a distance in a direction: one pass over the rays of a scan fills
// it, one pass over the table completes it, and each cell then takes a look-up per azimuth bin.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "core/base/check.h"
#include "core/base/vector_set.h"
#include "core/local/clear.h"

namespace gem {

/// The slope of no ray: it lowers nothing.
inline constexpr float kNoRay = std::numeric_limits<float>::infinity();

/// Where a table whose limit is range_bin_limit keeps a ray, and the slope that it keeps.
struct RayPlace {
  std::int32_t index = 0;
  float slope = kNoRay;
};
inline RayPlace RayPlaceOf(const Ray& ray, const RayBins& bins, std::int32_t range_bin_limit) {
  const std::int32_t range_bin = ray.range_bin < range_bin_limit ? ray.range_bin : range_bin_limit;
  return {range_bin * bins.azimuth + ray.azimuth_bin, range_bin > 0 ? ray.slope : kNoRay};
}

/// Azimuth bins [begin, end).
struct AzimuthSector {
  std::int32_t begin = 0, end = 0;

  std::size_t size() const { return static_cast<std::size_t>(end - begin); }
  bool Holds(std::int32_t azimuth_bin) const {
    return static_cast<std::uint32_t>(azimuth_bin - begin) <
           static_cast<std::uint32_t>(end - begin);
  }
};
inline AzimuthSector FullTurn(const RayBins& bins) { return {0, bins.azimuth}; }

class RayTable {
 public:
  explicit RayTable(const RayBins& bins)
      : bins_(bins),
        slopes_(static_cast<std::size_t>(bins.azimuth) * static_cast<std::size_t>(bins.range)) {}

  const RayBins& bins() const { return bins_; }

  /// Begins a scan. Cells whose range_bin_min is above the limit will not be asked for, so rays
  /// that end later are kept as if they ended there. 1 <= limit < bins().range.
  void SetLimit(std::int32_t range_bin_limit) {
    GEM_CHECK(range_bin_limit >= 1 && range_bin_limit < bins_.range);
    limit_ = range_bin_limit;
  }
  std::int32_t limit() const { return limit_; }

  // Threads may work on sectors that do not overlap at once.

  /// Forgets the rays in the sector; after SetLimit(), before the first Add().
  void Reset(const AzimuthSector& sector) {
    for (std::int32_t range_bin = 0; range_bin <= limit_; ++range_bin)
      std::fill_n(&slopes_[IndexAt(range_bin, sector.begin)], sector.size(), kNoRay);
  }

  /// Rays at places that RayPlaceOf() gave for bins() and the limit. Inline, as it belongs into the
  /// loop over a scan's points.
  void Add(const std::int32_t* places, const float* slopes, std::size_t count) {
    float* table = slopes_.data();
    for (std::size_t i = 0; i < count; ++i) {
      float& lowest = table[places[i]];
      lowest = slopes[i] < lowest ? slopes[i] : lowest;
    }
  }
  void Add(const Ray& ray) {
    const RayPlace place = RayPlaceOf(ray, bins_, limit_);
    Add(&place.index, &place.slope, 1);
  }

  /// To be called once for each sector, after its last Add: from here on a range bin holds the rays
  /// that end in it or later, and bin 0 all rays.
  void Complete(VectorSet set, const AzimuthSector& sector);

  /// Whether in every azimuth bin of the cell that holds rays one crosses the cell and passes below
  /// height_m. A bin without any ray, finer than the sensor's columns, says nothing.
  bool AllPassBelow(const CellSight& sight, float sensor_z_m, float height_m) const;
  /// The same of one azimuth bin, but true if it holds no rays. The cell is in sight. Branch-free:
  /// of many cells, it tells at once that most are not passed below.
  bool NonePassesAbove(const CellSight& sight, std::int32_t azimuth_bin, float sensor_z_m,
                       float height_m) const {
    const float any = slopes_[IndexAt(0, azimuth_bin)];
    const float crossing = slopes_[IndexAt(sight.range_bin_min, azimuth_bin)];
    // Where no ray crosses, the top of none is infinite.
    return (any == kNoRay) | (RayTopOver(sight, crossing, sensor_z_m) < height_m);
  }

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
