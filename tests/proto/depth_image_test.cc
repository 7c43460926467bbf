#include "proto/wire/depth_image.h"

#include <array>
#include <cmath>
#include <limits>

#include "gem/v1/types.pb.h"
#include "proto/wire/scan.h"
#include "tests/proto/refused.h"

namespace gem::wire {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

/// 4 x 3 pixels, all 2 m away.
constexpr std::array<std::uint16_t, 12> kDepths = {2000, 2000, 2000, 2000, 2000, 2000,
                                                   2000, 2000, 2000, 2000, 2000, 2000};
constexpr std::array<std::uint8_t, 36> kColors = {1, 2, 3};

v1::Scan GoodScan() {
  v1::Scan scan;
  scan.set_seq(1);
  scan.set_stamp_ns(100);
  scan.set_sensor("camera");
  DepthImage image;
  image.width = 4;
  image.height = 3;
  image.fx_px = image.fy_px = 2;
  image.cx_px = image.cy_px = 1;
  image.depth = std::as_bytes(std::span(kDepths));
  image.rgb = std::as_bytes(std::span(kColors));
  ToProto(image, scan.mutable_depth_image());
  return scan;
}

absl::Status Decode(const v1::Scan& scan, ScanLimits limits = {}) {
  DecodedScan decoded;
  return FromProto(scan, limits, FieldPath("scan"), decoded);
}

/// The good scan with one field of its image changed.
template <typename Change>
absl::Status DecodeWith(Change change) {
  v1::Scan scan = GoodScan();
  change(*scan.mutable_depth_image());
  return Decode(scan);
}

TEST(DepthImageFromProto, BecomesPoints) {
  DecodedScan decoded;
  decoded.time_offsets_s = {1, 2, 3};  // of the scan before
  ASSERT_TRUE(FromProto(GoodScan(), {}, FieldPath("scan"), decoded).ok());
  ASSERT_EQ(decoded.points.size(), 12u);
  EXPECT_TRUE(decoded.time_offsets_s.empty());
  EXPECT_EQ(decoded.sensor, "camera");
  EXPECT_FLOAT_EQ(decoded.points[0].x_m, -1);  // (0 - 1) / 2 * 2 m
  EXPECT_FLOAT_EQ(decoded.points[11].x_m, 2);  // (3 - 1) / 2 * 2 m
  EXPECT_FLOAT_EQ(decoded.points[11].y_m, 1);
  EXPECT_FLOAT_EQ(decoded.points[11].z_m, 2);
  EXPECT_EQ(decoded.points[0].rgba, 0xff030201u);
  EXPECT_EQ(PayloadBytes(GoodScan()), 24u + 36u);
}

TEST(DepthImageFromProto, TellsMillimetresAsItsUsualUnit) {
  v1::Scan scan = GoodScan();
  scan.mutable_depth_image()->set_scale(0);
  const auto image = FromProto(scan.depth_image(), ScanLimits(), FieldPath("depth_image"));
  ASSERT_TRUE(image.ok()) << image.status();
  EXPECT_EQ(image->unit_m, 0.001f);
  EXPECT_EQ(image->step, 1u);
}

TEST(DepthImageFromProto, RefusesBytesThatDoNotFitTheSize) {
  EXPECT_THAT(DecodeWith([](auto& image) { image.mutable_depth()->pop_back(); }),
              Refused("scan.depth_image.depth",
                      "scan.depth_image.depth is 23 bytes, want width * height * 2 = 4 * 3 * 2 = "
                      "24"));
  EXPECT_THAT(
      DecodeWith([](auto& image) { image.mutable_rgb()->push_back(0); }),
      Refused("scan.depth_image.rgb",
              "scan.depth_image.rgb is 37 bytes, want width * height * 3 = 4 * 3 * 3 = 36"));
  EXPECT_EQ(FieldOf(DecodeWith([](auto& image) {
              image.set_encoding(v1::DepthImage::ENCODING_FLOAT32);
              image.set_scale(0);
            })),
            "scan.depth_image.depth");
  // 16384 * 16384 * 16 is 2^32: not to be taken for nothing.
  EXPECT_EQ(FieldOf(DecodeWith([](auto& image) {
              image.set_width(16384);
              image.set_height(16384);
              image.set_fx(1000);
              image.set_fy(1000);
              image.clear_depth();
            })),
            "scan.depth_image.depth");
}

TEST(DepthImageFromProto, RefusesSizesThatNoImageHas) {
  EXPECT_THAT(DecodeWith([](auto& image) { image.set_width(0); }),
              Refused("scan.depth_image.width", "scan.depth_image.width is 0, want 1 to 16384"));
  EXPECT_THAT(
      DecodeWith([](auto& image) { image.set_height(16385); }),
      Refused("scan.depth_image.height", "scan.depth_image.height is 16385, want 1 to 16384"));
  EXPECT_THAT(
      DecodeWith([](auto& image) { image.set_step(65); }),
      Refused("scan.depth_image.step", "scan.depth_image.step is 65, want 0 (means 1) to 64"));
}

TEST(DepthImageFromProto, RefusesCamerasThatCannotBe) {
  EXPECT_THAT(DecodeWith([](auto& image) { image.set_fx(0); }),
              Refused("scan.depth_image.fx", "scan.depth_image.fx is 0, want 0.002 to 1e+06"));
  for (const double focal_px : {-1.0, kNan, 2e6, 1.9e-3})
    EXPECT_EQ(FieldOf(DecodeWith([&](auto& image) { image.set_fy(focal_px); })),
              focal_px == 1.9e-3 ? "" : "scan.depth_image.fy");
  EXPECT_THAT(DecodeWith([](auto& image) { image.set_cx(kNan); }),
              Refused("scan.depth_image.cx",
                      "scan.depth_image.cx is nan, want at most 1e+06 in magnitude"));
  // Rays steeper than 1000 : 1 would leave the range of coordinates.
  EXPECT_THAT(DecodeWith([](auto& image) { image.set_cy(5000); }),
              Refused("scan.depth_image.fy", "scan.depth_image.fy is 2, want 5 to 1e+06"));
}

TEST(DepthImageFromProto, RefusesEncodingsAndScalesThatMeanNothing) {
  EXPECT_THAT(DecodeWith([](auto& image) { image.clear_encoding(); }),
              Refused("scan.depth_image.encoding",
                      "scan.depth_image.encoding is 0, want ENCODING_UINT16 or ENCODING_FLOAT32"));
  EXPECT_THAT(
      DecodeWith([](auto& image) { image.set_scale(2); }),
      Refused("scan.depth_image.scale", "scan.depth_image.scale is 2, want 0 (means 0.001) to 1"));
  EXPECT_EQ(FieldOf(DecodeWith([](auto& image) { image.set_scale(kNan); })),
            "scan.depth_image.scale");
  EXPECT_THAT(DecodeWith([](auto& image) { image.set_encoding(v1::DepthImage::ENCODING_FLOAT32); }),
              Refused("scan.depth_image.scale",
                      "scan.depth_image.scale is 0.001, want 0 for "
                      "ENCODING_FLOAT32"));
}

TEST(DepthImageFromProto, RefusesMoreThanTheLimits) {
  const absl::Status bytes = Decode(GoodScan(), {.scan_bytes_max = 59, .points_max = 12});
  EXPECT_THAT(bytes, Refused("scan.depth_image.depth",
                             "scan.depth_image.depth is 60 bytes with rgb, want at most 59"));
  EXPECT_EQ(ReasonOf(bytes), ProblemReason::kTooLarge);
  const absl::Status points = Decode(GoodScan(), {.scan_bytes_max = 60, .points_max = 11});
  EXPECT_THAT(points,
              Refused("scan.depth_image",
                      "scan.depth_image is an image of 12 sampled pixels, want at most 11"));
  EXPECT_EQ(ReasonOf(points), ProblemReason::kTooLarge);
  EXPECT_TRUE(Decode(GoodScan(), {.scan_bytes_max = 60, .points_max = 12}).ok());
  v1::Scan every_second = GoodScan();
  every_second.mutable_depth_image()->set_step(2);
  EXPECT_TRUE(Decode(every_second, {.scan_bytes_max = 60, .points_max = 4}).ok());
}

}  // namespace
}  // namespace gem::wire
