#include "core/sensor/depth_image.h"

#include <cstring>

namespace gem {
namespace {

/// Pixels come as they lay in a message: nobody promises that they are aligned.
template <typename T>
T Load(const std::byte* at) {
  T value;
  std::memcpy(&value, at, sizeof(T));
  return value;
}

Rgba ColorAt(const std::byte* rgb) {
  return static_cast<Rgba>(rgb[0]) | static_cast<Rgba>(rgb[1]) << 8 |
         static_cast<Rgba>(rgb[2]) << 16 | 0xff000000u;
}

template <typename T>
void UnprojectAs(const DepthImage& image, float unit_m, std::vector<ScanPoint>& points) {
  // Slopes in double: the principal point is subtracted from pixels of the same size.
  const auto slope = [](std::uint32_t pixel, double center_px, double focal_px) {
    return static_cast<float>((pixel - center_px) / focal_px);
  };
  for (std::uint32_t v = 0; v < image.height; v += image.step) {
    const std::size_t row = std::size_t{v} * image.width;
    const float y_per_z = slope(v, image.cy_px, image.fy_px);
    for (std::uint32_t u = 0; u < image.width; u += image.step) {
      const std::size_t pixel = row + u;
      const float z_m =
          static_cast<float>(Load<T>(image.depth.data() + pixel * sizeof(T))) * unit_m;
      if (!(z_m > 0 && z_m <= kDepthMax_m)) continue;  // NaN, too
      const Rgba rgba = image.rgb.empty() ? 0 : ColorAt(image.rgb.data() + 3 * pixel);
      points.push_back({slope(u, image.cx_px, image.fx_px) * z_m, y_per_z * z_m, z_m, rgba});
    }
  }
}

}  // namespace

void Unproject(const DepthImage& image, std::vector<ScanPoint>& points) {
  points.clear();
  points.reserve(NumSampledPixels(image));
  if (image.encoding == DepthEncoding::kUint16) {
    UnprojectAs<std::uint16_t>(image, image.unit_m, points);
  } else {
    UnprojectAs<float>(image, 1, points);
  }
}

}  // namespace gem
