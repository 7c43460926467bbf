// Images as PNG: written with or without transparency, read as RGB. Knows nothing of maps.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

namespace gem {

struct Rgb {
  std::uint8_t red = 0;
  std::uint8_t green = 0;
  std::uint8_t blue = 0;
  friend bool operator==(const Rgb&, const Rgb&) = default;
};
static_assert(sizeof(Rgb) == 3, "pixels are handed to libpng as they lie");

/// Pixels by rows from the top left.
struct Image {
  std::int32_t width = 0;
  std::int32_t height = 0;
  std::vector<Rgb> pixels;

  Rgb At(std::int32_t x, std::int32_t y) const {
    return pixels[static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
                  static_cast<std::size_t>(x)];
  }
};

/// Pixels by rows from the top left: red in the lowest byte, then green, blue and alpha (0
/// transparent, 255 opaque).
struct TransparentImage {
  std::int32_t width = 0;
  std::int32_t height = 0;
  std::vector<std::uint32_t> pixels;

  std::uint32_t At(std::int32_t x, std::int32_t y) const {
    return pixels[static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
                  static_cast<std::size_t>(x)];
  }
};

/// The bytes of a PNG file.
absl::StatusOr<std::string> ToPng(const Image& image);
absl::StatusOr<std::string> ToPng(const TransparentImage& image);

/// Reads a PNG file of any kind; grey becomes three equal channels, transparency is dropped onto
/// black. NOT_FOUND or INVALID_ARGUMENT names the file; more than 2^26 pixels are refused before
/// they are decoded.
absl::StatusOr<Image> ReadPng(const std::string& path);

}  // namespace gem
