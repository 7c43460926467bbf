// Points as a driver packs them for the wire: x, y and z as int16, each of a scale. Whoever
// measures them decodes them, so that nobody writes them out as floats in between.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>

#include "core/sensor/scan_point.h"

namespace gem {

/// Somebody else holds the bytes. In the sensor frame, without colours.
struct PackedPoints {
  const char* bytes = nullptr;
  std::size_t count = 0;
  std::uint32_t stride = 0;                  ///< bytes from one point to the next
  std::array<std::uint32_t, 3> offset = {};  ///< bytes from the point to its x, y and z
  std::array<float, 3> scale_m = {};         ///< metres of 1

  /// Nothing but x, y and z, one after the other.
  bool is_tight() const { return stride == 6 && offset == std::array<std::uint32_t, 3>{0, 2, 4}; }
};

inline ScanPoint PointAt(const PackedPoints& packed, std::size_t index) {
  const char* point = packed.bytes + index * packed.stride;
  const auto coordinate_m = [&](std::size_t axis) {
    std::int16_t value = 0;
    std::memcpy(&value, point + packed.offset[axis], sizeof(value));
    return static_cast<float>(value) * packed.scale_m[axis];
  };
  return {coordinate_m(0), coordinate_m(1), coordinate_m(2), 0};
}

}  // namespace gem
