// The bytes of gem.v1.Scan.points -> points, by their layout.
#pragma once

#include <optional>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"
#include "core/sensor/packed_points.h"
#include "core/sensor/scan_point.h"
#include "proto/wire/field_path.h"
#include "proto/wire/point_layout.h"

namespace gem::wire {

/// bytes: whole points. INVALID_ARGUMENT names the first point and axis that is not finite, or
/// beyond kCoordinateMax_m.
absl::Status DecodePoints(absl::string_view bytes, const PointLayout& layout,
                          const FieldPath& field, std::vector<ScanPoint>& points);

/// Empty without a time offset; else one of each point. INVALID_ARGUMENT names the first that is
/// not finite, or beyond kTimeOffsetMax_s.
absl::Status DecodeTimeOffsets(absl::string_view bytes, const PointLayout& layout,
                               const FieldPath& field, std::vector<float>& time_offsets_s);

/// The points as they lie, if they are nothing but coordinates of which none can be out of range,
/// whatever the bytes are: then nobody has to look at them before they are measured.
std::optional<PackedPoints> AsPacked(absl::string_view bytes, const PointLayout& layout);

}  // namespace gem::wire
