// Small differences of either sign as small unsigned numbers: 0, -1, 1, -2, ... become 0, 1, 2, 3,
// ... modulo the width of T, so that every difference has one code and every code one difference.
#pragma once

#include <cstdint>
#include <type_traits>

namespace gem::wire {

/// difference: modulo 2^width.
template <typename T>
constexpr T Zigzag(T difference) {
  static_assert(std::is_unsigned_v<T>);
  const bool negative = (difference >> (8 * sizeof(T) - 1)) != 0;
  return static_cast<T>((difference << 1) ^ (negative ? static_cast<T>(-1) : T{0}));
}

template <typename T>
constexpr T Unzigzag(T code) {
  static_assert(std::is_unsigned_v<T>);
  return static_cast<T>((code >> 1) ^ ((code & 1) != 0 ? static_cast<T>(-1) : T{0}));
}

static_assert(Zigzag<std::uint16_t>(0xffff) == 1);
static_assert(Zigzag<std::uint16_t>(0x8000) == 0xffff);
static_assert(Unzigzag<std::uint32_t>(0xffffffff) == 0x80000000);
static_assert(Unzigzag<std::uint8_t>(2) == 1);

}  // namespace gem::wire
