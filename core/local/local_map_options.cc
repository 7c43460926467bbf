#include "core/local/local_map_options.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/str_cat.h"
#include "core/base/status_macros.h"
#include "core/grid/cell_index.h"

namespace gem {
namespace {

constexpr int kSideCells_min = 5;  // one neighbourhood of a plane fit

absl::Status OutOfRange(const char* field, double value, const std::string& range) {
  return absl::InvalidArgumentError(
      absl::StrCat("local_map.", field, " is ", value, ", want ", range));
}

// In [low, high]. Written so that NaN fails.
absl::Status InClosed(const char* field, double value, double low, double high) {
  if (value >= low && value <= high) return absl::OkStatus();
  return OutOfRange(field, value, absl::StrCat("[", low, ", ", high, "]"));
}

// In (low, high].
absl::Status InHalfOpen(const char* field, double value, double low, double high) {
  if (value > low && value <= high) return absl::OkStatus();
  return OutOfRange(field, value, absl::StrCat("(", low, ", ", high, "]"));
}

// In (low, high).
absl::Status InOpen(const char* field, double value, double low, double high) {
  if (value > low && value < high) return absl::OkStatus();
  return OutOfRange(field, value, absl::StrCat("(", low, ", ", high, ")"));
}

double SideInCells(const LocalMapOptions& options) {
  // 7.0f / 0.7f is a little above 10: what the caller wrote as whole cells stays whole cells.
  constexpr double kRounding = 1e-6;
  return std::ceil(static_cast<double>(options.side_m) / static_cast<double>(options.cell_size_m) *
                   (1.0 - kRounding));
}

absl::Status ValidateWindow(const LocalMapOptions& options) {
  GEM_RETURN_IF_ERROR(InClosed("cell_size_m", options.cell_size_m, kCellSizeMin_m, kCellSizeMax_m));
  const double side_cells = SideInCells(options);
  if (side_cells >= kSideCells_min && side_cells <= kLocalSideCells_max) return absl::OkStatus();
  return OutOfRange("side_m", options.side_m,
                    absl::StrCat(kSideCells_min, " to ", kLocalSideCells_max, " cells of ",
                                 options.cell_size_m, " m"));
}

absl::Status ValidateMeasuring(const LocalMapOptions& options) {
  GEM_RETURN_IF_ERROR(InHalfOpen("range_m_max", options.range_m_max, 0, 1000));
  if (!(options.range_m_min >= 0 && options.range_m_min < options.range_m_max)) {
    return OutOfRange("range_m_min", options.range_m_min,
                      absl::StrCat("[0, ", options.range_m_max, ")"));
  }
  GEM_RETURN_IF_ERROR(InHalfOpen("height_m_max", options.height_m_max, -1000, 1000));
  if (!(options.height_m_min >= -1000 && options.height_m_min < options.height_m_max)) {
    return OutOfRange("height_m_min", options.height_m_min,
                      absl::StrCat("[-1000, ", options.height_m_max, ")"));
  }
  const BodyBox& body = options.body;
  GEM_RETURN_IF_ERROR(InClosed("body.x_m_max", body.x_m_max, -1000, 1000));
  GEM_RETURN_IF_ERROR(InClosed("body.y_m_max", body.y_m_max, -1000, 1000));
  GEM_RETURN_IF_ERROR(InClosed("body.z_m_max", body.z_m_max, -1000, 1000));
  GEM_RETURN_IF_ERROR(InClosed("body.x_m_min", body.x_m_min, -1000, body.x_m_max));
  GEM_RETURN_IF_ERROR(InClosed("body.y_m_min", body.y_m_min, -1000, body.y_m_max));
  return InClosed("body.z_m_min", body.z_m_min, -1000, body.z_m_max);
}

absl::Status ValidateFusing(const LocalMapOptions& options) {
  GEM_RETURN_IF_ERROR(InHalfOpen("gate_sigmas", options.gate_sigmas, 0, 100));
  GEM_RETURN_IF_ERROR(InHalfOpen("variance_m2_max", options.variance_m2_max, 0, 1e4));
  GEM_RETURN_IF_ERROR(
      InOpen("variance_m2_min", options.variance_m2_min, 0, options.variance_m2_max));
  GEM_RETURN_IF_ERROR(InClosed("variance_growth_m2_per_s", options.variance_growth_m2_per_s, 0, 1));
  GEM_RETURN_IF_ERROR(InClosed("variance_growth_m2_per_m", options.variance_growth_m2_per_m, 0, 1));
  return InClosed("below_gate_inflation", options.below_gate_inflation, 1, 1000);
}

absl::Status ValidateAnnotating(const LocalMapOptions& options) {
  // The float nearest to pi/2 lies above it: compare with that.
  constexpr float kRightAngle_rad = 1.57079633f;
  GEM_RETURN_IF_ERROR(InClosed("slope_weight", options.slope_weight, 0, 1));
  GEM_RETURN_IF_ERROR(InClosed("roughness_weight", options.roughness_weight, 0, 1));
  GEM_RETURN_IF_ERROR(
      InHalfOpen("slope_critical_rad", options.slope_critical_rad, 0, kRightAngle_rad));
  GEM_RETURN_IF_ERROR(InHalfOpen("roughness_critical_m", options.roughness_critical_m, 0, 10));
  GEM_RETURN_IF_ERROR(InOpen("traversability_free", options.traversability_free, 0, 1));
  return InClosed("plane_cells_min", options.plane_cells_min, 3, 25);
}

}  // namespace

absl::Status Validate(const LocalMapOptions& options) {
  GEM_RETURN_IF_ERROR(ValidateWindow(options));
  GEM_RETURN_IF_ERROR(ValidateMeasuring(options));
  GEM_RETURN_IF_ERROR(ValidateFusing(options));
  GEM_RETURN_IF_ERROR(ValidateAnnotating(options));
  return InClosed("clear_sigmas", options.clear_sigmas, 0, 100);
}

std::int32_t SideCells(const LocalMapOptions& options) {
  return static_cast<std::int32_t>(SideInCells(options));
}

}  // namespace gem
