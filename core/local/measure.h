// Measuring, GEM eqs. (1)-(4): from a point of the scan to a height over a cell of the window, with
// its variance. Pure functions that every backend shares; nothing here knows how cells are stored.
#pragma once

#include <cmath>
#include <cstdint>

#include "core/base/host_device.h"
#include "core/grid/cell_index.h"
#include "core/local/local_map_options.h"
#include "core/sensor/noise_model.h"
#include "core/sensor/scan_point.h"

namespace gem {

struct Scan;

/// What all points of one scan have in common: how the scan lies over the window, and the limits.
/// Horizontal coordinates count from the window's lower left corner, so that floats stay precise
/// however far from the origin of O the robot is; the subtraction is done in double.
struct ScanFrame {
  float R_OS[3][3];  ///< rotation of T_O_S
  float R_BS[3][3];  ///< rotation of T_B_S
  float t_BS_m[3];   ///< translation of T_B_S

  float sensor_x_m, sensor_y_m;  ///< sensor over the window's corner
  float sensor_z_m;              ///< elevation of the sensor in O
  float sensor_over_base_m;      ///< sensor's elevation minus the base's
  float base_x_m, base_y_m;      ///< base over the window's corner

  /// Horizontal block of Sigma_phi turned into the axes of O, rad^2.
  float phi_xx_rad2, phi_xy_rad2, phi_yy_rad2;

  float range2_m2_min, range2_m2_max;
  float height_m_min, height_m_max;
  BodyBox body;
  bool has_body;

  float cell_size_m;
  std::int32_t side_cells;
  NoiseModel noise;
};

/// The scan over a window whose lower left cell is `origin`. Host only: it works in double.
ScanFrame MakeScanFrame(const Scan& scan, CellIndex origin, const LocalMapOptions& options);

/// What becomes of a point. The tests run in this order and the first that fails names the fate.
enum class PointFate : std::uint8_t {
  kOutOfRange,
  kOnBody,
  kTooLow,
  kTooHigh,
  kOutsideWindow,
  kInWindow,
};

/// A measured point seen from the sensor, with the axes of O.
struct Beam {
  float x_m, y_m, z_m;
  float range_m;
  PointFate fate;
  std::int32_t column, row;  ///< cell in the window from the lower left; set if kInWindow
};

/// A ray says something about the cells it crosses, unless its end is not believed: too near, too
/// far, the robot itself, or below the ground (a reflection, whose path beyond the mirror is not
/// where it seems). A point above the height window is real and its ray counts.
GEM_HOST_DEVICE inline bool RayCounts(PointFate fate) {
  return fate == PointFate::kInWindow || fate == PointFate::kOutsideWindow ||
         fate == PointFate::kTooHigh;
}

GEM_HOST_DEVICE inline bool InBody(const ScanFrame& frame, const ScanPoint& p_S) {
  const auto& R = frame.R_BS;
  const float x = R[0][0] * p_S.x_m + R[0][1] * p_S.y_m + R[0][2] * p_S.z_m + frame.t_BS_m[0];
  const float y = R[1][0] * p_S.x_m + R[1][1] * p_S.y_m + R[1][2] * p_S.z_m + frame.t_BS_m[1];
  const float z = R[2][0] * p_S.x_m + R[2][1] * p_S.y_m + R[2][2] * p_S.z_m + frame.t_BS_m[2];
  const BodyBox& box = frame.body;
  return (x >= box.x_m_min) & (x <= box.x_m_max) & (y >= box.y_m_min) & (y <= box.y_m_max) &
         (z >= box.z_m_min) & (z <= box.z_m_max);
}

GEM_HOST_DEVICE inline float Range2Of(const ScanPoint& p_S) {
  return p_S.x_m * p_S.x_m + p_S.y_m * p_S.y_m + p_S.z_m * p_S.z_m;
}
/// Also what overflows is out of range, so that nothing later meets an infinity.
GEM_HOST_DEVICE inline bool InRange(const ScanFrame& frame, float range2_m2) {
  return (range2_m2 >= frame.range2_m2_min) & (range2_m2 <= frame.range2_m2_max);
}

/// A point seen from the sensor, with the axes of O; metres.
struct Offset {
  float x_m, y_m, z_m;
};
GEM_HOST_DEVICE inline Offset OffsetOf(const ScanFrame& frame, const ScanPoint& p_S) {
  const auto& R = frame.R_OS;
  return {R[0][0] * p_S.x_m + R[0][1] * p_S.y_m + R[0][2] * p_S.z_m,
          R[1][0] * p_S.x_m + R[1][1] * p_S.y_m + R[1][2] * p_S.z_m,
          R[2][0] * p_S.x_m + R[2][1] * p_S.y_m + R[2][2] * p_S.z_m};
}

/// A place over the window, in cells from its lower left corner.
struct WindowPlace {
  float column, row;
};
GEM_HOST_DEVICE inline WindowPlace WindowPlaceOf(const ScanFrame& frame, const Offset& offset) {
  // Dividing, not multiplying by the inverse, which would move borders that floats hold exactly.
  return {(frame.sensor_x_m + offset.x_m) / frame.cell_size_m,
          (frame.sensor_y_m + offset.y_m) / frame.cell_size_m};
}
GEM_HOST_DEVICE inline bool InWindow(const ScanFrame& frame, const WindowPlace& place) {
  const auto side = static_cast<float>(frame.side_cells);
  return (place.column >= 0.0f) & (place.column < side) & (place.row >= 0.0f) & (place.row < side);
}

/// Eq. (1) without the elevation of the sensor, and the cell of the point.
GEM_HOST_DEVICE inline Beam MeasureBeam(const ScanFrame& frame, const ScanPoint& p_S) {
  Beam beam{0, 0, 0, 0, PointFate::kOutOfRange, 0, 0};
  const float range2_m2 = Range2Of(p_S);
  if (!InRange(frame, range2_m2)) return beam;
  beam.range_m = std::sqrt(range2_m2);
  if (frame.has_body && InBody(frame, p_S)) {
    beam.fate = PointFate::kOnBody;
    return beam;
  }
  const Offset offset = OffsetOf(frame, p_S);
  beam.x_m = offset.x_m;
  beam.y_m = offset.y_m;
  beam.z_m = offset.z_m;
  const float height_m = offset.z_m + frame.sensor_over_base_m;
  if (height_m < frame.height_m_min) {
    beam.fate = PointFate::kTooLow;
    return beam;
  }
  if (height_m > frame.height_m_max) {
    beam.fate = PointFate::kTooHigh;
    return beam;
  }
  const WindowPlace place = WindowPlaceOf(frame, offset);
  beam.fate = PointFate::kOutsideWindow;
  if (InWindow(frame, place)) {
    beam.fate = PointFate::kInWindow;
    beam.column = static_cast<std::int32_t>(place.column);
    beam.row = static_cast<std::int32_t>(place.row);
  }
  return beam;
}

/// Eq. (1): elevation of the point in O, metres.
GEM_HOST_DEVICE inline float ElevationOf(const ScanFrame& frame, const Beam& beam) {
  return frame.sensor_z_m + beam.z_m;
}

/// First term of eq. (4): what the sensor adds to the variance of the point's elevation, m^2.
GEM_HOST_DEVICE inline float SensorVarianceOf(const ScanFrame& frame, const ScanPoint& p_S,
                                              const Beam& beam) {
  const auto& a = frame.R_OS[2];  // J_r, eq. (2)
  return VarianceAlong(frame.noise, a[0], a[1], a[2], p_S.x_m, p_S.y_m, p_S.z_m, beam.range_m);
}

/// Second term of eq. (4): what Sigma_phi adds at a place of the window, metres from its lower left
/// corner, m^2. For e = z of T_O_B * p_B and a perturbation R_OB (I + phi^x) with phi in B,
/// J_phi = -n [p_B]x, where n is the z row of R_OB. With q = R_OB p_B, the place over the base in
/// the axes of O, this is (q_y, -q_x, 0) R_OB: two coordinates and the horizontal block of
/// R_OB Sigma_phi R_OB^T are all it takes.
GEM_HOST_DEVICE inline float PoseVarianceAt(const ScanFrame& frame, float x_m, float y_m) {
  const float q_x = x_m - frame.base_x_m;
  const float q_y = y_m - frame.base_y_m;
  return q_y * q_y * frame.phi_xx_rad2 - 2.0f * q_x * q_y * frame.phi_xy_rad2 +
         q_x * q_x * frame.phi_yy_rad2;
}
/// The same in the middle of a cell: one value for all points of the scan in it, which share the
/// error.
GEM_HOST_DEVICE inline float PoseVarianceOfCell(const ScanFrame& frame, std::int32_t column,
                                                std::int32_t row) {
  return PoseVarianceAt(frame, (static_cast<float>(column) + 0.5f) * frame.cell_size_m,
                        (static_cast<float>(row) + 0.5f) * frame.cell_size_m);
}

}  // namespace gem
