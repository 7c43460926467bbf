// Annotating, GEM eq. (7): slope, roughness and traversability of a cell from the 5x5 cells around
// it. Pure functions that the cpu and the cuda backend share; the reference fits its planes by QR.
#pragma once

#include <cmath>
#include <cstdint>

#include "core/base/host_device.h"
#include "core/local/local_map_options.h"

namespace gem {

/// Cells on each side of the middle one in the neighbourhood of a plane fit.
inline constexpr std::int32_t kPlaneRadius_cells = 2;

struct Annotation {
  float slope_rad = 0;
  float roughness_m = 0;
  float traversability = 0;
  bool valid = false;
};

/// Sums over one column of the neighbourhood, from below: the sums of a plane fit are those of its
/// columns, and neighbours share columns. A backend may keep them, as they are always the same.
struct ColumnSums {
  std::int32_t count = 0;
  std::int32_t y = 0, yy = 0;
  double z = 0, yz = 0, zz = 0;

  /// dy in whole cells from the middle; height_m is relative to anything that is the same for all
  /// cells of a fit. Backends take the sensor, so that squares stay small.
  GEM_HOST_DEVICE void Add(std::int32_t dy, bool known, double height_m) {
    const std::int32_t one = known ? 1 : 0;
    const double known_m = known ? height_m : 0.0;
    const double dy_m = dy * known_m;
    count += one;
    y += dy * one;
    yy += dy * dy * one;
    z += known_m;
    yz += dy_m;
    zz += known_m * known_m;
  }
};

/// Sums of the normal equations of e = a x + b y + c, x and y in whole cells from the middle one.
/// Doubles, and integers where they are exact: no epsilon tells steep from flat or full from
/// degenerate. Always added in one order, so that all backends get the same bits: each column from
/// below, columns from the left, and those outside the window as columns without cells.
struct PlaneSums {
  std::int32_t count = 0;
  std::int32_t x = 0, y = 0, xx = 0, xy = 0, yy = 0;
  double z = 0, xz = 0, yz = 0, zz = 0;

  GEM_HOST_DEVICE void Add(std::int32_t dx, const ColumnSums& column) {
    count += column.count;
    x += dx * column.count;
    y += column.y;
    xx += dx * dx * column.count;
    xy += dx * column.y;
    yy += column.yy;
    z += column.z;
    xz += dx * column.z;
    yz += column.yz;
    zz += column.zz;
  }
};

/// A fitted plane: rise per cell along x and y, and the standard deviation of heights about it.
struct PlaneFit {
  double rise_x_m = 0, rise_y_m = 0;
  float roughness_m = 0;
};

/// Second moments of the places about their mean, times the count: exact integers.
struct PlaceMoments {
  std::int32_t xx, xy, yy;
  GEM_HOST_DEVICE std::int32_t determinant() const { return xx * yy - xy * xy; }
};
GEM_HOST_DEVICE inline PlaceMoments PlaceMomentsOf(const PlaneSums& sums) {
  const std::int32_t n = sums.count;
  return {n * sums.xx - sums.x * sums.x, n * sums.xy - sums.x * sums.y,
          n * sums.yy - sums.y * sums.y};
}

/// Whether there are enough cells, and not all on one line.
GEM_HOST_DEVICE inline bool HasPlane(const PlaneSums& sums, std::int32_t cells_min) {
  return (sums.count >= cells_min) & (PlaceMomentsOf(sums).determinant() != 0);
}

/// Least squares; means something if HasPlane(). Branch-free, as it runs over rows of cells.
GEM_HOST_DEVICE inline PlaneFit FitPlane(const PlaneSums& sums) {
  const PlaceMoments places = PlaceMomentsOf(sums);
  const std::int32_t determinant = places.determinant();
  const double inverse = 1.0 / (determinant != 0 ? determinant : 1);
  const std::int32_t n = sums.count;
  const double xz = n * sums.xz - sums.x * sums.z;
  const double yz = n * sums.yz - sums.y * sums.z;
  const double zz = n * sums.zz - sums.z * sums.z;
  PlaneFit fit;
  fit.rise_x_m = (places.yy * xz - places.xy * yz) * inverse;
  fit.rise_y_m = (places.xx * yz - places.xy * xz) * inverse;
  // Three heights are spent on the plane, so that the figure does not shrink where few are known.
  const std::int32_t freedom = n - 3;
  const auto squares_m2 =
      static_cast<float>(zz - fit.rise_x_m * xz - fit.rise_y_m * yz);  // times the count
  // Rounding may leave an exact plane a hair below zero.
  const float rest_m2 = ((freedom > 0) & (squares_m2 > 0.0f)) ? squares_m2 : 0.0f;
  fit.roughness_m = std::sqrt(rest_m2 / static_cast<float>(freedom > 0 ? n * freedom : 1));
  return fit;
}

/// Angle whose tangent is t >= 0, radians, to 3e-7. Additions, products, quotients and roots only:
/// they are rounded alike on every machine, which atan of the C library and of CUDA is not.
GEM_HOST_DEVICE inline float AngleOfTangent(float t) {
  const bool steep = t > 1.0f;
  const float u = (steep ? 1.0f : t) / (steep ? t : 1.0f);
  // Half the angle: |h| <= tan(pi / 8), where the series converges fast.
  const float h = u / (1.0f + std::sqrt(1.0f + u * u));
  const float h2 = h * h;
  float series = 1.0f / 13.0f - h2 * (1.0f / 15.0f);
  series = 1.0f / 11.0f - h2 * series;
  series = 1.0f / 9.0f - h2 * series;
  series = 1.0f / 7.0f - h2 * series;
  series = 1.0f / 5.0f - h2 * series;
  series = 1.0f / 3.0f - h2 * series;
  series = 1.0f - h2 * series;
  const float angle_rad = 2.0f * h * series;
  return steep ? 1.57079633f - angle_rad : angle_rad;
}

/// Eq. (7), clamped to [0, 1].
GEM_HOST_DEVICE inline float TraversabilityOf(float slope_rad, float roughness_m,
                                              const LocalMapOptions& options) {
  const float score = 1.0f - options.slope_weight * slope_rad / options.slope_critical_rad -
                      options.roughness_weight * roughness_m / options.roughness_critical_m;
  return score < 0.0f ? 0.0f : score;
}

GEM_HOST_DEVICE inline float SlopeOf(const PlaneFit& fit, float cell_size_m) {
  const auto rise_x_m = static_cast<float>(fit.rise_x_m);
  const auto rise_y_m = static_cast<float>(fit.rise_y_m);
  return AngleOfTangent(std::sqrt(rise_x_m * rise_x_m + rise_y_m * rise_y_m) / cell_size_m);
}

/// The annotation of the cell in the middle; all zero without a plane.
GEM_HOST_DEVICE inline Annotation AnnotationOf(const PlaneSums& sums,
                                               const LocalMapOptions& options) {
  Annotation annotation;
  if (!HasPlane(sums, options.plane_cells_min)) return annotation;
  const PlaneFit fit = FitPlane(sums);
  annotation.slope_rad = SlopeOf(fit, options.cell_size_m);
  annotation.roughness_m = fit.roughness_m;
  annotation.traversability =
      TraversabilityOf(annotation.slope_rad, annotation.roughness_m, options);
  annotation.valid = true;
  return annotation;
}

}  // namespace gem
