// Where the values of a point lie within the bytes of gem.v1.Scan.points.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "absl/status/statusor.h"
#include "proto/wire/field_path.h"
#include "proto/wire/scan_codec.h"

namespace gem::v1 {
class Scan;
}  // namespace gem::v1

namespace gem::wire {

inline constexpr std::array<const char*, 3> kAxisNames = {"x", "y", "z"};
inline constexpr char kColorName[] = "rgba";
inline constexpr char kTimeOffsetName[] = "time_offset";

/// Types that a value of a point may have for us.
enum class ValueType : std::uint8_t { kFloat32, kInt16, kUint32 };

struct Column {
  bool present = false;
  ValueType type = ValueType::kFloat32;
  std::uint32_t offset = 0;  ///< bytes from the point
  float scale = 1;           ///< of kInt16
};

/// Every value lies within the stride.
struct PointLayout {
  std::uint32_t stride = 0;   ///< bytes from one point to the next
  std::array<Column, 3> xyz;  ///< present, kFloat32 or kInt16
  Column rgba;                ///< kUint32
  Column time_offset;         ///< kFloat32, seconds, or kUint32, nanoseconds
};

/// INVALID_ARGUMENT names the field that does not describe a point.
absl::StatusOr<PointLayout> LayoutFromProto(const v1::Scan& proto, const FieldPath& field);

/// All fields of a layout that was checked, those without a meaning too, as the byte planes of the
/// codec want them.
std::vector<PointColumn> PointColumnsOf(const v1::Scan& proto);

}  // namespace gem::wire
