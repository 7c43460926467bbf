// Writes the contents of a section: little endian, lists of numbers as byte planes.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <string>
#include <type_traits>

#include "absl/strings/string_view.h"
#include "core/geometry/pose.h"

namespace gem::map_file {

/// The unsigned number with the bits of a T.
template <typename T>
using BitsOf = std::conditional_t<
    sizeof(T) == 1, std::uint8_t,
    std::conditional_t<sizeof(T) == 2, std::uint16_t,
                       std::conditional_t<sizeof(T) == 4, std::uint32_t, std::uint64_t>>>;

class ByteWriter {
 public:
  template <typename T>
  void Number(T value) {
    auto bits = std::bit_cast<BitsOf<T>>(value);
    for (std::size_t i = 0; i < sizeof(T); ++i)
      bytes_ += static_cast<char>(static_cast<std::uint64_t>(bits) >> (8 * i) & 0xff);
  }

  /// At most 255 bytes, their number before them.
  void Text(absl::string_view text) {
    Number(static_cast<std::uint8_t>(text.size()));
    bytes_.append(text.data(), text.size());
  }

  template <typename A, typename B>
  void Transform(const Pose<A, B>& pose) {
    for (int i = 0; i < 4; ++i) Number(pose.rotation().coeffs()[i]);
    for (int i = 0; i < 3; ++i) Number(pose.translation()[i]);
  }

  /// value_of(i) for i from 0 to n - 1: the lowest bytes of all, then the next ones.
  template <typename ValueOf>
  void Column(std::size_t n, const ValueOf& value_of) {
    using T = std::decay_t<decltype(value_of(std::size_t{0}))>;
    const std::size_t begin = bytes_.size();
    bytes_.resize(begin + n * sizeof(T));
    for (std::size_t i = 0; i < n; ++i) {
      const auto bits = std::bit_cast<BitsOf<T>>(value_of(i));
      for (std::size_t plane = 0; plane < sizeof(T); ++plane)
        bytes_[begin + plane * n + i] =
            static_cast<char>(static_cast<std::uint64_t>(bits) >> (8 * plane) & 0xff);
    }
  }

  std::size_t size() const { return bytes_.size(); }
  const std::string& bytes() const { return bytes_; }

 private:
  std::string bytes_;
};

}  // namespace gem::map_file
