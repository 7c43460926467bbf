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

/// Sums of the normal equations of e = a x + b y + c, x and y in whole cells from the middle one.
/// Doubles, and integers where they are exact: no epsilon tells steep from flat or full from
/// degenerate, and the sums are the same in any order but for the last bits of a double.
struct PlaneSums {
  std::int32_t count = 0;
  std::int32_t x = 0, y = 0, xx = 0, xy = 0, yy = 0;
  double z = 0, xz = 0, yz = 0, zz = 0;

  /// height_m is relative to anything that is the same for all cells of the fit.
  GEM_HOST_DEVICE void Add(std::int32_t dx, std::int32_t dy, double height_m) {
    ++count;
    x += dx;
    y += dy;
    xx += dx * dx;
    xy += dx * dy;
    yy += dy * dy;
    z += height_m;
    xz += dx * height_m;
    yz += dy * height_m;
    zz += height_m * height_m;
  }
};

/// A fitted plane: rise per cell along x and y, and the standard deviation of heights about it.
struct PlaneFit {
  double rise_x_m = 0, rise_y_m = 0;
  double roughness_m = 0;
  bool valid = false;
};

/// Least squares. Invalid if there are fewer than cells_min cells or all lie on one line.
GEM_HOST_DEVICE inline PlaneFit FitPlane(const PlaneSums& sums, std::int32_t cells_min) {
  PlaneFit fit;
  if (sums.count < cells_min) return fit;
  // Second moments about the mean, times the count: exact integers.
  const std::int32_t n = sums.count;
  const std::int32_t xx = n * sums.xx - sums.x * sums.x;
  const std::int32_t xy = n * sums.xy - sums.x * sums.y;
  const std::int32_t yy = n * sums.yy - sums.y * sums.y;
  const std::int32_t determinant = xx * yy - xy * xy;
  if (determinant == 0) return fit;
  const double xz = n * sums.xz - sums.x * sums.z;
  const double yz = n * sums.yz - sums.y * sums.z;
  const double zz = n * sums.zz - sums.z * sums.z;
  fit.rise_x_m = (yy * xz - xy * yz) / determinant;
  fit.rise_y_m = (xx * yz - xy * xz) / determinant;
  // Three heights are spent on the plane, so that the figure does not shrink where few are known.
  const std::int32_t freedom = n - 3;
  const double squares_m2 = (zz - fit.rise_x_m * xz - fit.rise_y_m * yz) / n;
  // Rounding may leave an exact plane a hair below zero.
  fit.roughness_m = freedom > 0 && squares_m2 > 0 ? std::sqrt(squares_m2 / freedom) : 0.0;
  fit.valid = true;
  return fit;
}

/// Angle whose tangent is t >= 0, radians, to 1e-7. Additions, products, quotients and roots only:
/// they are rounded alike on every machine, which atan of the C library and of CUDA is not.
GEM_HOST_DEVICE inline double AngleOfTangent(double t) {
  const bool steep = t > 1.0;
  const double u = steep ? 1.0 / t : t;
  // Half the angle: |h| <= tan(pi / 8), where the series converges fast.
  const double h = u / (1.0 + std::sqrt(1.0 + u * u));
  const double h2 = h * h;
  double series = 1.0 / 17.0;
  for (int odd = 15; odd >= 1; odd -= 2) series = 1.0 / odd - h2 * series;
  const double angle_rad = 2.0 * h * series;
  return steep ? 1.57079632679489661923 - angle_rad : angle_rad;
}

/// Eq. (7), clamped to [0, 1].
GEM_HOST_DEVICE inline float TraversabilityOf(float slope_rad, float roughness_m,
                                              const LocalMapOptions& options) {
  const float score = 1.0f - options.slope_weight * slope_rad / options.slope_critical_rad -
                      options.roughness_weight * roughness_m / options.roughness_critical_m;
  return score < 0.0f ? 0.0f : score;
}

GEM_HOST_DEVICE inline Annotation AnnotatePlane(const PlaneFit& fit,
                                                const LocalMapOptions& options) {
  Annotation annotation;
  if (!fit.valid) return annotation;
  const double cell_size_m = static_cast<double>(options.cell_size_m);
  const double rise_m = std::sqrt(fit.rise_x_m * fit.rise_x_m + fit.rise_y_m * fit.rise_y_m);
  annotation.slope_rad = static_cast<float>(AngleOfTangent(rise_m / cell_size_m));
  annotation.roughness_m = static_cast<float>(fit.roughness_m);
  annotation.traversability =
      TraversabilityOf(annotation.slope_rad, annotation.roughness_m, options);
  annotation.valid = true;
  return annotation;
}

}  // namespace gem
