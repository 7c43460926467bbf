// How a backend is held against the reference: states and heights to the last bit, the annotation
// within stated tolerances. An empty answer means that the maps agree.
#pragma once

#include <cmath>
#include <string>

#include "absl/strings/str_cat.h"
#include "core/local/local_map.h"
#include "core/local/local_mapper.h"

namespace gem::testing {

/// Planes are fitted in two ways: slope in radians, roughness in metres, traversability.
inline constexpr float kAnnotationTolerance = 1e-5f;

inline std::string CellToText(const LocalMap& map, std::size_t i) {
  return absl::StrCat("{state ", map.state[i], ", elevation ", map.elevation_m[i], ", variance ",
                      map.variance_m2[i], ", slope ", map.slope_rad[i], ", roughness ",
                      map.roughness_m[i], ", traversability ", map.traversability[i], ", rgba ",
                      map.rgba[i], ", observed ", map.observed_ns[i], "}");
}

/// The first difference in words, or "".
inline std::string DifferenceOf(const LocalMap& expected, const LocalMap& actual) {
  if (expected.side_cells != actual.side_cells || expected.origin != actual.origin ||
      expected.seq != actual.seq || expected.stamp_ns != actual.stamp_ns ||
      expected.num_cells() != actual.num_cells()) {
    return "the windows differ";
  }
  const auto near = [](float a, float b) { return std::fabs(a - b) <= kAnnotationTolerance; };
  for (std::size_t i = 0; i < expected.num_cells(); ++i) {
    const bool same =
        expected.state[i] == actual.state[i] && expected.elevation_m[i] == actual.elevation_m[i] &&
        expected.variance_m2[i] == actual.variance_m2[i] && expected.rgba[i] == actual.rgba[i] &&
        expected.observed_ns[i] == actual.observed_ns[i] &&
        near(expected.slope_rad[i], actual.slope_rad[i]) &&
        near(expected.roughness_m[i], actual.roughness_m[i]) &&
        near(expected.traversability[i], actual.traversability[i]);
    if (!same) {
      return absl::StrCat("cell ", i, ": expected ", CellToText(expected, i), ", got ",
                          CellToText(actual, i));
    }
  }
  return "";
}

inline std::string DifferenceOf(const ScanReport& expected, const ScanReport& actual) {
  const auto text = [](const ScanReport& r) {
    return absl::StrCat(r.points, " points, outside ", r.points_outside_window, ", range ",
                        r.points_out_of_range, ", height ", r.points_out_of_height, ", body ",
                        r.points_on_body, ", fused ", r.points_fused, ", gated ", r.points_gated,
                        "; cells evicted ", r.cells_evicted, ", restarted ", r.cells_restarted,
                        ", inflated ", r.cells_inflated, ", cleared ", r.cells_cleared);
  };
  const std::string a = text(expected), b = text(actual);
  return a == b ? "" : absl::StrCat("expected ", a, ", got ", b);
}

/// The documented sum.
inline bool EveryPointCountedOnce(const ScanReport& r) {
  return r.points == r.points_outside_window + r.points_out_of_range + r.points_out_of_height +
                         r.points_on_body + r.points_fused + r.points_gated;
}

}  // namespace gem::testing
