// Fusing, GEM eqs. (5)-(6): what the points of one scan over one cell do to the belief of the cell.
// Pure functions that every backend shares. The result depends on the order of the points only.
#pragma once

#include <cstdint>

#include "core/base/host_device.h"
#include "core/grid/cell_belief.h"
#include "core/local/local_map_options.h"

namespace gem {

/// A height over a cell, in O.
struct Height {
  float elevation_m = 0;
  float variance_m2 = 0;
};

/// A point of the scan over a cell.
struct Hit {
  Height height;  ///< variance: of the sensor alone
  Rgba rgba = 0;
};

/// The fusing part of the options, as the backends pass it around.
struct FuseLimits {
  float gate2;  ///< gate of eq. (5), squared
  float variance_m2_min, variance_m2_max;
  float below_gate_inflation;
};
inline FuseLimits FuseLimitsOf(const LocalMapOptions& options) {
  return {options.gate_sigmas * options.gate_sigmas, options.variance_m2_min,
          options.variance_m2_max, options.below_gate_inflation};
}

/// A cell while points are fused. Colour stays in floats until the scan's last point: rounding
/// after each point would swallow small gains.
struct CellFusion {
  Height height;
  float red = 0, green = 0, blue = 0;
  bool known = false;
  bool colored = false;
};

GEM_HOST_DEVICE inline bool HasColor(Rgba rgba) { return (rgba >> 24) != 0; }

/// Share of a measurement in the fused belief, from eq. (6). Two values that are both perfectly
/// sure count alike.
GEM_HOST_DEVICE inline float GainOf(Height cell, Height z) {
  const float sum_m2 = cell.variance_m2 + z.variance_m2;
  return sum_m2 > 0.0f ? cell.variance_m2 / sum_m2 : 0.5f;
}

/// Eq. (6): (v_z e_g + v_g e) / (v_g + v_z) and v_g v_z / (v_g + v_z), written with the gain, so
/// that elevations far from zero keep their precision.
GEM_HOST_DEVICE inline Height FuseHeight(Height cell, Height z) {
  const float gain = GainOf(cell, z);
  return {cell.elevation_m + gain * (z.elevation_m - cell.elevation_m), gain * z.variance_m2};
}

/// The belief that one point alone gives.
GEM_HOST_DEVICE inline CellFusion BeginCell(const Hit& hit) {
  CellFusion cell;
  cell.height = hit.height;
  cell.known = true;
  cell.colored = HasColor(hit.rgba);
  if (cell.colored) {
    cell.red = static_cast<float>(hit.rgba & 255u);
    cell.green = static_cast<float>((hit.rgba >> 8) & 255u);
    cell.blue = static_cast<float>((hit.rgba >> 16) & 255u);
  }
  return cell;
}

/// Fuses a point into what the scan says of the cell so far: height by eq. (6), colour by the same
/// gain.
GEM_HOST_DEVICE inline CellFusion FuseHit(CellFusion scan, const Hit& hit) {
  if (!scan.known) return BeginCell(hit);
  if (HasColor(hit.rgba)) {
    const CellFusion alone = BeginCell(hit);
    // The first colour has nothing to be averaged with.
    const float gain = scan.colored ? GainOf(scan.height, hit.height) : 1.0f;
    scan.red += gain * (alone.red - scan.red);
    scan.green += gain * (alone.green - scan.green);
    scan.blue += gain * (alone.blue - scan.blue);
    scan.colored = true;
  }
  scan.height = FuseHeight(scan.height, hit.height);
  return scan;
}

/// A cell in the middle of a scan. All points of a scan share the error of the pose (Sigma_phi of
/// eq. (4)), which therefore does not average out over them: they are fused among themselves first,
/// by the sensor's variance, and what they say together is fused with the prior once. Without an
/// error of the pose this is eq. (6), point by point.
struct ScanFusion {
  CellFusion prior;     ///< unknown: the scan decides alone
  CellFusion scan;      ///< variance: of the sensor alone; unknown before the first point
  float pose_m2 = 0.0;  ///< variance that the pose adds at this cell

  /// Share of the scan in the belief.
  GEM_HOST_DEVICE float Gain() const {
    if (!scan.known) return 0.0f;
    if (!prior.known) return 1.0f;
    return GainOf(prior.height, {0, scan.height.variance_m2 + pose_m2});
  }
};

/// Eq. (5) with the variance of the point as well: a noisy point is not an outlier. Compared in
/// squares. The cell counts as no surer than the floor, also in the middle of a scan. In so far as
/// the belief comes from this scan, the error of the pose is the point's as well and cancels.
GEM_HOST_DEVICE inline bool PassesGate(const ScanFusion& cell, Height z, const FuseLimits& limits) {
  const float gain = cell.Gain(), rest = 1.0f - gain;
  const float prior_m = cell.prior.height.elevation_m;
  const float difference_m =
      z.elevation_m - (prior_m + gain * (cell.scan.height.elevation_m - prior_m));
  float cell_m2 = rest * rest * (cell.prior.height.variance_m2 + cell.pose_m2) +
                  gain * gain * cell.scan.height.variance_m2;
  if (cell_m2 < limits.variance_m2_min) cell_m2 = limits.variance_m2_min;
  return difference_m * difference_m <= limits.gate2 * (cell_m2 + z.variance_m2);
}

/// The belief after the scan's last point.
GEM_HOST_DEVICE inline CellFusion FuseScanInto(const ScanFusion& cell) {
  CellFusion fused = cell.prior;
  if (!cell.scan.known) return fused;
  const float scan_m2 = cell.scan.height.variance_m2 + cell.pose_m2;
  if (!cell.prior.known) {
    fused = cell.scan;
    fused.height.variance_m2 = scan_m2;
    return fused;
  }
  fused.height = FuseHeight(fused.height, {cell.scan.height.elevation_m, scan_m2});
  if (!cell.scan.colored) return fused;
  const float gain = fused.colored ? cell.Gain() : 1.0f;
  fused.red += gain * (cell.scan.red - fused.red);
  fused.green += gain * (cell.scan.green - fused.green);
  fused.blue += gain * (cell.scan.blue - fused.blue);
  fused.colored = true;
  return fused;
}

GEM_HOST_DEVICE inline Rgba PackColor(const CellFusion& cell) {
  if (!cell.colored) return 0;
  // Averages of bytes stay within 0..255, so adding a half rounds and never overflows.
  return static_cast<Rgba>(cell.red + 0.5f) | (static_cast<Rgba>(cell.green + 0.5f) << 8) |
         (static_cast<Rgba>(cell.blue + 0.5f) << 16) | 0xff000000u;
}
GEM_HOST_DEVICE inline CellFusion UnpackCell(Height height, Rgba rgba) {
  return BeginCell(Hit{height, rgba});
}

GEM_HOST_DEVICE inline float ClampVariance(float variance_m2, const FuseLimits& limits) {
  if (variance_m2 < limits.variance_m2_min) return limits.variance_m2_min;
  return variance_m2 > limits.variance_m2_max ? limits.variance_m2_max : variance_m2;
}

/// Variance of a cell after the last point of a scan.
GEM_HOST_DEVICE inline float SettleVariance(float variance_m2, bool inflated,
                                            const FuseLimits& limits) {
  const float inflation = inflated ? limits.below_gate_inflation : 1.0f;
  return ClampVariance(ClampVariance(variance_m2, limits) * inflation, limits);
}

/// Variance of a cell that was not observed for a while. growth_m2 = rate * time.
GEM_HOST_DEVICE inline float GrowVariance(float variance_m2, float growth_m2,
                                          const FuseLimits& limits) {
  const float grown_m2 = variance_m2 + growth_m2;
  return grown_m2 > limits.variance_m2_max ? limits.variance_m2_max : grown_m2;
}

/// Growth of every cell's variance from one scan to the next, m^2: the world changes with time, and
/// odometry drifts with the way.
inline float GrowthOver(std::int64_t from_ns, std::int64_t to_ns, double way_m,
                        const LocalMapOptions& options) {
  // In double: the difference of two stamps of unknown origin may not fit an int64.
  const double seconds = (static_cast<double>(to_ns) - static_cast<double>(from_ns)) * 1e-9;
  return static_cast<float>(options.variance_growth_m2_per_s * (seconds > 0 ? seconds : 0) +
                            options.variance_growth_m2_per_m * way_m);
}

/// What one scan did to one cell.
struct FuseOutcome {
  std::uint32_t fused = 0;  ///< points that passed the gate, or began or restarted the cell
  std::uint32_t gated = 0;  ///< the others
  bool restarted = false;   ///< the highest point was above the gate
  bool inflated = false;    ///< traversable, and the highest point was below the gate
};

/// Fuses one scan's points over one cell, in their order. The highest (the first of equals) is
/// tested first: above the gate, the cell restarts from it, as an unknown cell begins from it;
/// below the gate, a traversable cell was not seen where it is believed and becomes less sure. Then
/// every other point that passes is fused. The floor is applied once, after the last point.
/// pose_m2: variance that the pose adds at this cell.
GEM_HOST_DEVICE inline FuseOutcome FuseCell(CellFusion& cell, const Hit* hits, std::uint32_t count,
                                            bool traversable, float pose_m2,
                                            const FuseLimits& limits) {
  FuseOutcome outcome;
  std::uint32_t highest = 0;
  for (std::uint32_t i = 1; i < count; ++i) {
    if (hits[i].height.elevation_m > hits[highest].height.elevation_m) highest = i;
  }
  ScanFusion fusion{cell, CellFusion(), pose_m2};
  std::uint32_t begun_from = count;
  if (!cell.known) {
    begun_from = highest;
  } else if (!PassesGate(fusion, hits[highest].height, limits)) {
    if (hits[highest].height.elevation_m > cell.height.elevation_m) {
      begun_from = highest;
      outcome.restarted = true;
    } else {
      outcome.inflated = traversable;
    }
  }
  if (begun_from != count) {
    fusion.prior = CellFusion();
    fusion.scan = BeginCell(hits[begun_from]);
    outcome.fused = 1;
  }
  for (std::uint32_t i = 0; i < count; ++i) {
    if (i == begun_from) continue;  // it is in the cell already
    if (PassesGate(fusion, hits[i].height, limits)) {
      fusion.scan = FuseHit(fusion.scan, hits[i]);
      ++outcome.fused;
    } else {
      ++outcome.gated;
    }
  }
  cell = FuseScanInto(fusion);
  cell.height.variance_m2 = SettleVariance(cell.height.variance_m2, outcome.inflated, limits);
  return outcome;
}

}  // namespace gem
