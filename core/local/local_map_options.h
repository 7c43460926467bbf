// Options of the local dense mapper (paper section IV), with unit, default, range and reason.
#pragma once

#include <cstdint>

#include "absl/status/status.h"

namespace gem {

/// Cells a side of the window, at most.
inline constexpr int kLocalSideCells_max = 1024;

/// The robot's own body in B, metres: points inside are not terrain.
struct BodyBox {
  float x_m_min = 0, y_m_min = 0, z_m_min = 0;
  float x_m_max = 0, y_m_max = 0, z_m_max = 0;
};

struct LocalMapOptions {
  /// Edge of a cell. Halving it quadruples memory and map traffic. Range [0.01, 10].
  float cell_size_m = 0.2f;
  /// Edge of the square window. Rounded up to whole cells, at least 5 and at most 1024 cells a
  /// side.
  float side_m = 8.0f;

  // Measuring, eqs. (1)-(4).
  /// Points nearer to the sensor are noise or the robot itself. Range [0, range_m_max).
  float range_m_min = 0.5f;
  /// Points farther from the sensor are too noisy. Range (range_m_min, 1000].
  float range_m_max = 120.0f;
  /// Points lower over the base than this (along z of O) are reflections. Range [-1000,
  /// height_m_max).
  float height_m_min = -10.0f;
  /// Points higher over the base than this are what the robot passes under. Range (height_m_min,
  /// 1000].
  float height_m_max = 3.0f;
  /// Empty (all zero) by default: it belongs to the robot.
  BodyBox body;

  // Fusing, eqs. (5)-(6).
  /// Chi-square gate of eq. (5), in standard deviations. Range (0, 100].
  float gate_sigmas = 3.0f;
  /// A cell never becomes surer than this, so that a moved crate is forgotten after a few scans
  /// instead of after a few thousand. Range (0, variance_m2_max).
  float variance_m2_min = 1e-4f;
  /// A cell never becomes less sure than this. Range (variance_m2_min, 1e4].
  float variance_m2_max = 1.0f;
  /// Growth of the variance with the time since the last observation, m^2/s. Range [0, 1].
  float variance_growth_m2_per_s = 1e-5f;
  /// Growth of the variance with the robot's way since the last observation, m^2/m: odometry drifts
  /// in height, by 3 mm in a metre and 1 cm in ten. Range [0, 1].
  float variance_growth_m2_per_m = 1e-5f;
  /// Factor on the variance of a traversable cell whose highest point of a scan lies below the
  /// gate: ground that sank is learnt again after a few scans. Range [1, 1000].
  float below_gate_inflation = 4.0f;

  // Annotating, eq. (7).
  float slope_weight = 0.5f;          ///< w_s, [0, 1]
  float roughness_weight = 0.5f;      ///< w_r, [0, 1]
  float slope_critical_rad = 0.6f;    ///< (0, pi/2]
  float roughness_critical_m = 0.2f;  ///< (0, 10]
  /// Cells above this are traversable ("free"), others are obstacles. Range (0, 1).
  float traversability_free = 0.7f;
  /// A plane is fitted to the 5x5 neighbourhood if at least so many of its cells are known. Range
  /// [3, 25].
  std::int32_t plane_cells_min = 8;

  // Clearing, section IV-C. An obstacle, or a known cell that is not annotated, is cleared when
  // rays of this scan end beyond it and every azimuth bin of the cell in which rays end holds one
  // that crosses the cell whole and passes below it. A free cell is cleared likewise, but only rays
  // that pass at least roughness_critical_m below it count.
  /// A ray passes below a cell only if it is below its height minus this many standard deviations.
  /// Range [0, 100].
  float clear_sigmas = 3.0f;
};

/// INVALID_ARGUMENT: "local_map.cell_size_m is -1, want [0.01, 10]".
absl::Status Validate(const LocalMapOptions& options);

/// Cells a side of the window that valid options describe.
std::int32_t SideCells(const LocalMapOptions& options);

}  // namespace gem
