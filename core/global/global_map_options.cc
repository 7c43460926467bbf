#include "core/global/global_map_options.h"

#include <string>

#include "absl/strings/str_cat.h"
#include "core/base/status_macros.h"
#include "core/grid/cell_index.h"

namespace gem {
namespace {

absl::Status Check(bool in_range, const char* field, double value, const std::string& range) {
  if (in_range) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat("map.", field, " is ", value, ", want ", range));
}

// In [low, high]. Written so that NaN fails.
absl::Status InClosed(const char* field, double value, double low, double high) {
  return Check(value >= low && value <= high, field, value,
               absl::StrCat("[", low, ", ", high, "]"));
}

// In (low, high].
absl::Status InHalfOpen(const char* field, double value, double low, double high) {
  return Check(value > low && value <= high, field, value, absl::StrCat("(", low, ", ", high, "]"));
}

}  // namespace

absl::Status Validate(const GlobalMapOptions& options) {
  // Bounds of floats are compared as floats: 0.01f is a little below 0.01.
  GEM_RETURN_IF_ERROR(Check(
      options.cell_size_m >= kCellSizeMin_m && options.cell_size_m <= kCellSizeMax_m, "cell_size_m",
      options.cell_size_m, absl::StrCat("[", kCellSizeMin_m, ", ", kCellSizeMax_m, "]")));
  GEM_RETURN_IF_ERROR(Check(options.submap_length_m >= 0.1f && options.submap_length_m <= 10000.0f,
                            "submap_length_m", options.submap_length_m, "[0.1, 10000]"));
  GEM_RETURN_IF_ERROR(Check(options.traversability_free > 0 && options.traversability_free < 1,
                            "traversability_free", options.traversability_free, "(0, 1)"));
  GEM_RETURN_IF_ERROR(InHalfOpen("gate_sigmas", options.gate_sigmas, 0, 100));
  GEM_RETURN_IF_ERROR(InClosed("compose_threads", options.compose_threads, 1, 64));
  GEM_RETURN_IF_ERROR(InHalfOpen("merge_overlap_min", options.merge_overlap_min, 0, 1000));
  GEM_RETURN_IF_ERROR(InClosed("merge_fuse_time_s_max", options.merge_fuse_time_s_max, 0, 1e9));
  GEM_RETURN_IF_ERROR(
      InHalfOpen("merge_height_difference_m_max", options.merge_height_difference_m_max, 0, 1000));
  return InClosed("odometry_poses_max", options.odometry_poses_max, 2, 1e8);
}

}  // namespace gem
