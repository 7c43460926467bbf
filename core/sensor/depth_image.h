// Depth images and how they become points: a pinhole without distortion. What a valid image is, the
// wire decides (proto/wire/depth_image.h).
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/sensor/scan.h"

namespace gem {

/// Little endian.
enum class DepthEncoding : std::uint8_t {
  kUint16,   ///< times unit_m; 0: no measurement
  kFloat32,  ///< metres
};

/// Deeper is no measurement: beyond the range limit of every local map.
inline constexpr float kDepthMax_m = 1000;

/// An image of depths whose pixels somebody else holds. S is the camera: x right, y down, z
/// forward.
struct DepthImage {
  std::uint32_t width = 0;   ///< pixels a row
  std::uint32_t height = 0;  ///< rows
  double fx_px = 0;          ///< focal lengths, positive
  double fy_px = 0;
  double cx_px = 0;  ///< principal point; (0, 0) is the middle of the upper left pixel
  double cy_px = 0;
  DepthEncoding encoding = DepthEncoding::kUint16;
  float unit_m = 0.001f;   ///< of kUint16
  std::uint32_t step = 1;  ///< every step-th pixel of every step-th row is used; at least 1
  std::span<const std::byte> depth;  ///< by rows from the top, without padding
  std::span<const std::byte> rgb;    ///< red, green, blue of each pixel, or empty
};

/// How many pixels are looked at: no more points can come out.
constexpr std::uint64_t NumSampledPixels(const DepthImage& image) {
  const std::uint64_t columns = (std::uint64_t{image.width} + image.step - 1) / image.step;
  const std::uint64_t rows = (std::uint64_t{image.height} + image.step - 1) / image.step;
  return columns * rows;
}

/// p_S = ((u - cx) / fx * z, (v - cy) / fy * z, z) of each sampled pixel (u, v) with a measurement,
/// by rows: 0 < z <= kDepthMax_m. Replaces `points` and reuses its buffer. The image is valid: as
/// many bytes as its size needs.
void Unproject(const DepthImage& image, std::vector<ScanPoint>& points);

}  // namespace gem
