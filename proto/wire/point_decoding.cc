#include "proto/wire/point_decoding.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <span>

#include "absl/strings/str_cat.h"
#include "core/grid/cell_index.h"
#include "core/sensor/deskew.h"
#include "proto/wire/refusal.h"

namespace gem::wire {
namespace {

static_assert(std::endian::native == std::endian::little, "points are copied as they lie");

template <typename T>
T Load(const char* at) {
  T value;
  std::memcpy(&value, at, sizeof(T));
  return value;
}

float LoadAxis(const char* point, const Column& column) {
  if (column.type == ValueType::kInt16)
    return static_cast<float>(Load<std::int16_t>(point + column.offset)) * column.scale;
  return Load<float>(point + column.offset);
}

bool InRange(float value_m) { return std::abs(value_m) <= static_cast<float>(kCoordinateMax_m); }

absl::Status RefusePoint(const ScanPoint& point, std::size_t index, const FieldPath& field) {
  const FieldPath points = field.Child("points");
  const FieldPath element = points.At(index);
  const std::array<float, 3> xyz = {point.x_m, point.y_m, point.z_m};
  for (std::size_t axis = 0; axis < xyz.size(); ++axis) {
    if (!std::isfinite(xyz[axis]))
      return Refuse(element.Child(kAxisNames[axis]), xyz[axis], "a finite number");
    if (!InRange(xyz[axis]))
      return Refuse(element.Child(kAxisNames[axis]), xyz[axis],
                    absl::StrCat("at most ", kCoordinateMax_m, " in magnitude"));
  }
  return absl::InternalError("a point that is in range was refused");
}

/// Seconds; a UINT32 holds nanoseconds.
float LoadTimeOffset_s(const char* point, const Column& column) {
  if (column.type == ValueType::kUint32)
    return static_cast<float>(Load<std::uint32_t>(point + column.offset) * 1e-9);
  return Load<float>(point + column.offset);
}

/// Grows with the magnitude; NaN exceeds infinity.
std::int32_t MagnitudeBits(float value) {
  return std::bit_cast<std::int32_t>(value) & std::numeric_limits<std::int32_t>::max();
}

/// x, y and z, all stored as Axis, and no colour. Without a branch, which doubles the speed of
/// INT16. False if a point is out of range.
template <typename Axis>
bool DecodeAxes(const char* at, const PointLayout& layout, std::span<ScanPoint> points) {
  const std::int32_t most = MagnitudeBits(static_cast<float>(kCoordinateMax_m));
  const auto& [x, y, z] = layout.xyz;
  std::int32_t beyond = 0;  // negative once one is
  for (ScanPoint& point : points) {
    point = {static_cast<float>(Load<Axis>(at + x.offset)) * x.scale,
             static_cast<float>(Load<Axis>(at + y.offset)) * y.scale,
             static_cast<float>(Load<Axis>(at + z.offset)) * z.scale, 0};
    beyond |= (most - MagnitudeBits(point.x_m)) | (most - MagnitudeBits(point.y_m)) |
              (most - MagnitudeBits(point.z_m));
    at += layout.stride;
  }
  return beyond >= 0;
}

void DecodeMixedAxes(const char* at, const PointLayout& layout, std::span<ScanPoint> points) {
  const auto& [x, y, z] = layout.xyz;
  for (ScanPoint& point : points) {
    point = {LoadAxis(at, x), LoadAxis(at, y), LoadAxis(at, z), 0};
    at += layout.stride;
  }
}

void DecodeColors(const char* at, const PointLayout& layout, std::span<ScanPoint> points) {
  for (ScanPoint& point : points) {
    const Rgba rgba = Load<Rgba>(at + layout.rgba.offset);
    // Inside the mapper a colour is there (alpha 255) or not (0): half transparent means there.
    point.rgba = (rgba >> 24) == 0 ? 0 : rgba | 0xff000000u;
    at += layout.stride;
  }
}

}  // namespace

absl::Status DecodePoints(absl::string_view packed, const PointLayout& layout,
                          const FieldPath& field, std::vector<ScanPoint>& points) {
  points.resize(packed.size() / layout.stride);
  const char* at = packed.data();
  const auto are = [&](ValueType type) {
    return std::all_of(layout.xyz.begin(), layout.xyz.end(),
                       [&](const Column& column) { return column.type == type; });
  };
  bool in_range = false;  // or not known to be
  if (are(ValueType::kFloat32)) {
    in_range = DecodeAxes<float>(at, layout, points);
  } else if (are(ValueType::kInt16)) {
    in_range = DecodeAxes<std::int16_t>(at, layout, points);
  } else {
    DecodeMixedAxes(at, layout, points);
  }
  for (std::size_t i = 0; i < points.size() && !in_range; ++i) {
    const ScanPoint& point = points[i];
    if (!(InRange(point.x_m) && InRange(point.y_m) && InRange(point.z_m)))
      return RefusePoint(point, i, field);
  }
  if (layout.rgba.present) DecodeColors(at, layout, points);
  return absl::OkStatus();
}

absl::Status DecodeTimeOffsets(absl::string_view packed, const PointLayout& layout,
                               const FieldPath& field, std::vector<float>& time_offsets_s) {
  time_offsets_s.resize(layout.time_offset.present ? packed.size() / layout.stride : 0);
  const char* at = packed.data();
  for (std::size_t i = 0; i < time_offsets_s.size(); ++i, at += layout.stride) {
    time_offsets_s[i] = LoadTimeOffset_s(at, layout.time_offset);
    if (!(std::abs(time_offsets_s[i]) <= kTimeOffsetMax_s)) [[unlikely]] {  // NaN, too
      const FieldPath points = field.Child("points");
      const FieldPath point = points.At(i);
      return Refuse(point.Child(kTimeOffsetName), time_offsets_s[i],
                    absl::StrCat("at most ", kTimeOffsetMax_s, " s in magnitude"));
    }
  }
  return absl::OkStatus();
}

std::optional<PackedPoints> AsPacked(absl::string_view bytes, const PointLayout& layout) {
  constexpr float kMagnitudeMax = 32768;
  if (layout.rgba.present || layout.time_offset.present) return std::nullopt;
  PackedPoints packed;
  packed.bytes = bytes.data();
  packed.count = bytes.size() / layout.stride;
  packed.stride = layout.stride;
  for (std::size_t axis = 0; axis < layout.xyz.size(); ++axis) {
    const Column& column = layout.xyz[axis];
    if (column.type != ValueType::kInt16 || !InRange(kMagnitudeMax * column.scale))
      return std::nullopt;
    packed.offset[axis] = column.offset;
    packed.scale_m[axis] = column.scale;
  }
  return packed;
}

}  // namespace gem::wire
