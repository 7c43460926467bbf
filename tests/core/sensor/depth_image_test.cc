#include "core/sensor/depth_image.h"

#include <gtest/gtest.h>

#include <array>
#include <cstring>
#include <limits>

namespace gem {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr float kInfinity = std::numeric_limits<float>::infinity();

/// 4 x 2 pixels, focal lengths 2 and 4 pixels, the axis through pixel (1, 0).
template <typename T>
DepthImage ImageOf(const std::array<T, 8>& depths) {
  DepthImage image;
  image.width = 4;
  image.height = 2;
  image.fx_px = 2;
  image.fy_px = 4;
  image.cx_px = 1;
  image.cy_px = 0;
  image.encoding = sizeof(T) == 2 ? DepthEncoding::kUint16 : DepthEncoding::kFloat32;
  image.depth = std::as_bytes(std::span(depths));
  return image;
}

void ExpectPoint(const ScanPoint& point, float x_m, float y_m, float z_m) {
  EXPECT_FLOAT_EQ(point.x_m, x_m);
  EXPECT_FLOAT_EQ(point.y_m, y_m);
  EXPECT_FLOAT_EQ(point.z_m, z_m);
}

TEST(Unproject, PutsPixelsWhereTheirRaysEnd) {
  const std::array<std::uint16_t, 8> depths = {1000, 1000, 0, 4000, 0, 0, 0, 2000};
  std::vector<ScanPoint> points;
  Unproject(ImageOf(depths), points);
  ASSERT_EQ(points.size(), 4u);
  ExpectPoint(points[0], -0.5f, 0, 1);  // (0 - 1) / 2 * 1 m
  ExpectPoint(points[1], 0, 0, 1);      // on the axis
  ExpectPoint(points[2], 4, 0, 4);      // (3 - 1) / 2 * 4 m
  ExpectPoint(points[3], 2, 0.5f, 2);   // y points down: row 1 lies below the axis
  EXPECT_EQ(points[0].rgba, 0u);
}

TEST(Unproject, SkipsWhatIsNoMeasurement) {
  const std::array<float, 8> depths = {0, kNan, kInfinity, -kInfinity, -1, 1001, 1000, 0.25f};
  std::vector<ScanPoint> points;
  Unproject(ImageOf(depths), points);
  ASSERT_EQ(points.size(), 2u);
  EXPECT_EQ(points[0].z_m, 1000);
  EXPECT_EQ(points[1].z_m, 0.25f);
}

TEST(Unproject, ScalesIntegersByTheirUnit) {
  const std::array<std::uint16_t, 8> depths = {0, 5000};
  DepthImage image = ImageOf(depths);
  image.unit_m = 0.0002f;
  std::vector<ScanPoint> points;
  Unproject(image, points);
  ASSERT_EQ(points.size(), 1u);
  EXPECT_FLOAT_EQ(points[0].z_m, 1);
}

TEST(Unproject, TakesTheColourOfThePixel) {
  const std::array<std::uint16_t, 8> depths = {0, 0, 0, 0, 0, 0, 1000, 0};
  std::array<std::uint8_t, 24> rgb = {};
  rgb[18] = 0x11;
  rgb[19] = 0x22;
  rgb[20] = 0x33;
  DepthImage image = ImageOf(depths);
  image.rgb = std::as_bytes(std::span(rgb));
  std::vector<ScanPoint> points;
  Unproject(image, points);
  ASSERT_EQ(points.size(), 1u);
  EXPECT_EQ(points[0].rgba, 0xff332211u);  // red in the lowest byte
}

TEST(Unproject, StepsOverPixelsInBothDirections) {
  const std::array<std::uint16_t, 8> depths = {1, 2, 3, 4, 5, 6, 7, 8};
  DepthImage image = ImageOf(depths);
  image.step = 3;
  std::vector<ScanPoint> points(100);
  Unproject(image, points);
  EXPECT_EQ(NumSampledPixels(image), 2u);
  ASSERT_EQ(points.size(), 2u);  // columns 0 and 3 of row 0
  EXPECT_FLOAT_EQ(points[0].z_m, 0.001f);
  EXPECT_FLOAT_EQ(points[1].z_m, 0.004f);
}

TEST(Unproject, ReadsPixelsThatAreNotAligned) {
  const std::array<float, 8> depths = {1, 2, 3, 4, 5, 6, 7, 8};
  std::vector<std::byte> bytes(1 + sizeof(depths));
  std::memcpy(bytes.data() + 1, depths.data(), sizeof(depths));
  DepthImage image = ImageOf(depths);
  image.depth = std::span(bytes).subspan(1);
  std::vector<ScanPoint> points;
  Unproject(image, points);
  ASSERT_EQ(points.size(), 8u);
  EXPECT_EQ(points[7].z_m, 8);
}

}  // namespace
}  // namespace gem
