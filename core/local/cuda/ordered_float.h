// Floats as unsigned integers of the same order, so that an integer minimum is the minimum of
// floats: what atomics of a GPU can do.
#pragma once

#include <cstdint>
#include <cstring>

#include "core/base/host_device.h"

namespace gem::cuda {

/// Above every finite float and infinity; all bytes are equal, so that a memset writes it.
inline constexpr std::uint32_t kNoFloat = 0xffffffffu;

/// Not for NaN. Negative zero comes before zero.
GEM_HOST_DEVICE inline std::uint32_t OrderedFrom(float value) {
  std::uint32_t bits;
  std::memcpy(&bits, &value, sizeof(bits));
  return (bits & 0x80000000u) != 0 ? ~bits : bits | 0x80000000u;
}
GEM_HOST_DEVICE inline float FloatFrom(std::uint32_t ordered) {
  const std::uint32_t bits = (ordered & 0x80000000u) != 0 ? ordered & 0x7fffffffu : ~ordered;
  float value;
  std::memcpy(&value, &bits, sizeof(value));
  return value;
}

}  // namespace gem::cuda
