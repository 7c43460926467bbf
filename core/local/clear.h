// Clearing, paper section IV-C: which cells a ray of the scan passes below. Pure functions of one
// ray and one cell; the cpu backend asks them of a table, the reference of every point.
//
// Seen from the sensor a ray is an azimuth bin, a range bin and a slope, and a cell is an interval
// of azimuth bins and a span of ranges. A ray crosses a cell if its bin lies wholly within the
// cell's angle and it ends in a later range bin than the cell's farthest corner: then it crosses
// the whole cell, and no corner of it is judged by a ray that passes beside it.
//
// A cell is cleared if rays pass below it in every azimuth bin of it that holds rays at all. One
// bin would not do: a post, or the edge of a crate, fills a part of its cell only, and rays past it
// would clear what still stands there.
#pragma once

#include <cmath>
#include <cstdint>

#include "core/base/host_device.h"
#include "core/local/local_map_options.h"

namespace gem {

/// How finely rays are told apart. Range bins are one cell deep.
struct RayBins {
  std::int32_t azimuth = 0;  ///< bins a full turn, a multiple of 4
  std::int32_t range = 0;    ///< bins from the sensor outwards; the last holds all that is farther
  float cell_size_m = 0;
};

/// Enough azimuth bins that a cell in the far corner of the window, seen from its middle, spans
/// four (up to 256 cells a side, and one at 1024), and enough range bins for a sensor anywhere over
/// the window.
inline RayBins RayBinsOf(std::int32_t side_cells, float cell_size_m) {
  std::int32_t azimuth = 1024;
  while (azimuth < 16 * side_cells && azimuth < 4096) azimuth *= 2;
  constexpr double kDiagonal = 1.4142135623730951;
  const auto range = static_cast<std::int32_t>(std::ceil(side_cells * kDiagonal)) + 2;
  return {azimuth, range, cell_size_m};
}

/// Direction of (x, y), counter-clockwise from +x, as a number in [0, 4): it rises with the angle,
/// a quarter turn is 1, and half a turn is always 2. No trigonometry, so every machine agrees.
/// (0, 0) has no direction and gives 0. Branch-free, for it runs over every ray.
GEM_HOST_DEVICE inline float DiamondAngle(float x, float y) {
  const float sum = std::fabs(x) + std::fabs(y);
  const float fraction = y / (sum > 0.0f ? sum : 1.0f);
  // A direction just below +x may round to 4 itself.
  const float right = fraction < 0.0f ? 4.0f + fraction : fraction;
  return x < 0.0f ? 2.0f - fraction : right;
}

/// A direction in units of azimuth bins, [0, bins].
GEM_HOST_DEVICE inline float AzimuthOf(float x, float y, const RayBins& bins) {
  return DiamondAngle(x, y) * (static_cast<float>(bins.azimuth) * 0.25f);
}
GEM_HOST_DEVICE inline std::int32_t AzimuthBinOf(float x, float y, const RayBins& bins) {
  const auto bin = static_cast<std::int32_t>(AzimuthOf(x, y, bins));
  return bin < bins.azimuth ? bin : bins.azimuth - 1;
}
/// A distance in units of range bins. The inverse is the same for all rays, and multiplying costs
/// less than dividing; where exactly a bin ends matters to nobody.
GEM_HOST_DEVICE inline float RangeOf(float distance_m, const RayBins& bins) {
  return distance_m * (1.0f / bins.cell_size_m);
}
GEM_HOST_DEVICE inline std::int32_t RangeBinOf(float distance_m, const RayBins& bins) {
  const float bin = RangeOf(distance_m, bins);
  const auto last = static_cast<float>(bins.range - 1);
  return static_cast<std::int32_t>(bin < last ? bin : last);
}

/// A ray from the sensor, whose end is not believed to have missed.
struct Ray {
  std::int32_t azimuth_bin = 0;
  std::int32_t range_bin = 0;  ///< of the end; 0 says nothing about any cell
  float slope = 0;             ///< rise per horizontal metre
};

/// The ray that ends at (x, y, z), relative to the sensor, axes of O. A ray straight down has
/// neither azimuth nor slope; it ends in range bin 0 and is not asked for them.
GEM_HOST_DEVICE inline Ray RayTo(float x_m, float y_m, float z_m, const RayBins& bins) {
  const float distance_m = std::sqrt(x_m * x_m + y_m * y_m);
  return {AzimuthBinOf(x_m, y_m, bins), RangeBinOf(distance_m, bins),
          z_m / (distance_m > 0.0f ? distance_m : 1.0f)};
}

/// A cell as the sensor sees it.
struct CellSight {
  std::int32_t first_bin = 0;      ///< of the azimuth bins; they continue over the last to bin 0
  std::int32_t num_bins = 0;       ///< 0: no ray can say anything about this cell
  std::int32_t range_bin_min = 0;  ///< of the end of a ray that crosses the cell
  float near_m = 0, far_m = 0;  ///< horizontal distances of the cell's nearest and farthest place
};

/// Sight of the square [x, x + r] x [y, y + r] relative to the sensor. A cell that the sensor
/// stands over, or whose border it touches, is seen by no ray, nor is one beyond the last range bin
/// but one. Branch-free, for it runs over every cell that might be cleared.
GEM_HOST_DEVICE inline CellSight SightOf(float x_m, float y_m, const RayBins& bins) {
  CellSight sight;
  const float x0 = x_m, x1 = x_m + bins.cell_size_m;
  const float y0 = y_m, y1 = y_m + bins.cell_size_m;
  const bool right = x0 > 0.0f, left = x1<0.0f, above = y0> 0.0f, below = y1 < 0.0f;

  const float near_x = right ? x0 : left ? -x1 : 0.0f;
  const float near_y = above ? y0 : below ? -y1 : 0.0f;
  const float far_x = std::fabs(x0) > std::fabs(x1) ? x0 : x1;
  const float far_y = std::fabs(y0) > std::fabs(y1) ? y0 : y1;
  sight.near_m = std::sqrt(near_x * near_x + near_y * near_y);
  sight.far_m = std::sqrt(far_x * far_x + far_y * far_y);
  // Not RangeBinOf: a cell beyond the last bin must not look as if it were within it.
  const float far_bin = RangeOf(sight.far_m, bins);
  const bool in_sight =
      (right | left | above | below) & (far_bin < static_cast<float>(bins.range - 1));
  sight.range_bin_min = static_cast<std::int32_t>(in_sight ? far_bin : 0.0f) + 1;

  // The two corners that bound the square's angle: clockwise-most and counter-clockwise-most.
  const float start_x = (above | (!below & !right)) ? x1 : x0;
  const float start_y = (right | (!left & above)) ? y0 : y1;
  const float end_x = (above | (!below & right)) ? x0 : x1;
  const float end_y = (right | (!left & !above)) ? y1 : y0;
  const float start = AzimuthOf(start_x, start_y, bins);
  const float end = AzimuthOf(end_x, end_y, bins);
  const float end_after_start = end < start ? end + static_cast<float>(bins.azimuth) : end;
  const auto floor = static_cast<std::int32_t>(start);
  const std::int32_t first = floor + (static_cast<float>(floor) < start ? 1 : 0);
  const std::int32_t count = static_cast<std::int32_t>(end_after_start) - first;
  // A far cell may span no whole bin, or, when its corners round to one direction, seem to span the
  // full turn: it is judged by the bin of its middle, which errs by less than one bin.
  const std::int32_t middle = AzimuthBinOf(0.5f * (x0 + x1), 0.5f * (y0 + y1), bins);
  const bool narrow = (count < 1) | (count > bins.azimuth / 2);
  const std::int32_t wrapped = first < bins.azimuth ? first : first - bins.azimuth;
  sight.first_bin = narrow ? middle : wrapped;
  const std::int32_t width = narrow ? 1 : count;
  sight.num_bins = in_sight ? width : 0;
  return sight;
}

/// Height in O, within the cell, of a ray at the place of the cell where it is highest. It rises
/// with the slope, so the lowest of many rays is the one of lowest slope.
GEM_HOST_DEVICE inline float RayTopOver(const CellSight& sight, float slope, float sensor_z_m) {
  return sensor_z_m + slope * (slope < 0.0f ? sight.near_m : sight.far_m);
}

/// A ray must pass below this height to clear the cell: what the cell surely reaches. A free cell
/// is cleared only by rays that pass critically deep below it. That is no ground with its noise,
/// but the flat top of something that went away, which looks free where it is wider than the
/// neighbourhood of a plane fit, or stands alone among unknown cells.
GEM_HOST_DEVICE inline float ClearHeightOf(float elevation_m, float variance_m2, bool is_free,
                                           const LocalMapOptions& options) {
  const float sure_m = options.clear_sigmas * std::sqrt(variance_m2);
  const float depth_m =
      is_free && sure_m < options.roughness_critical_m ? options.roughness_critical_m : sure_m;
  return elevation_m - depth_m;
}

}  // namespace gem
