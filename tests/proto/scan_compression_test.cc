// Scans that come compressed: what they give, and what they are refused for.
#include <cmath>
#include <cstring>
#include <limits>

#include "gem/v1/types.pb.h"
#include "proto/wire/depth_image.h"
#include "proto/wire/scan.h"
#include "proto/wire/zstd_frame.h"
#include "tests/proto/refused.h"

namespace gem::wire {
namespace {

/// A quarter of a ring on the ground, with colours.
std::vector<ScanPoint> Ring() {
  std::vector<ScanPoint> points;
  for (int i = 0; i < 500; ++i) {
    const float angle = 0.003f * static_cast<float>(i);
    points.push_back(
        {10 * std::cos(angle), 10 * std::sin(angle), -1.7f, 0xff000000u | static_cast<Rgba>(i)});
  }
  return points;
}

v1::Scan RingScan(bool int16 = true) {
  v1::Scan scan;
  scan.set_seq(1);
  scan.set_stamp_ns(100);
  scan.set_sensor("top");
  const std::vector<float> offsets_s(500, 0.01f);
  if (int16) {
    EXPECT_TRUE(PointsToProtoInt16(Ring(), 0.004, &scan, offsets_s).ok());
  } else {
    PointsToProto(Ring(), &scan, offsets_s);
  }
  return scan;
}

v1::Scan Compressed(v1::Scan scan, ScanCompression compression) {
  Compress(compression, &scan);
  return scan;
}

absl::Status Decode(const v1::Scan& scan, DecodedScan& decoded, ScanLimits limits = {}) {
  return FromProto(scan, limits, FieldPath("scan"), decoded);
}

absl::Status Decode(const v1::Scan& scan, ScanLimits limits = {}) {
  DecodedScan decoded;
  return Decode(scan, decoded, limits);
}

/// Points are compared to the bit.
std::string BytesOf(const std::vector<ScanPoint>& points) {
  return {reinterpret_cast<const char*>(points.data()), points.size() * sizeof(ScanPoint)};
}

class EveryCompression : public testing::TestWithParam<std::tuple<ScanCompression, bool>> {};

TEST_P(EveryCompression, LosesNothing) {
  const auto [compression, int16] = GetParam();
  const v1::Scan plain = RingScan(int16);
  const v1::Scan compressed = Compressed(plain, compression);
  DecodedScan want, got;
  ASSERT_TRUE(Decode(plain, want).ok());
  ASSERT_TRUE(Decode(compressed, got).ok());
  EXPECT_EQ(BytesOf(got.points), BytesOf(want.points));
  EXPECT_EQ(got.time_offsets_s, want.time_offsets_s);
  if (compression != ScanCompression::kNone) {
    EXPECT_LT(PayloadBytes(compressed), PayloadBytes(plain)) << "credit counts what is sent";
  }
}

INSTANTIATE_TEST_SUITE_P(All, EveryCompression,
                         testing::Combine(testing::Values(ScanCompression::kNone,
                                                          ScanCompression::kZstd,
                                                          ScanCompression::kDeltaZstd),
                                          testing::Bool()));

TEST(ScanCompression, OfAScanThatSawNothingIsFine) {
  for (const auto compression : {ScanCompression::kZstd, ScanCompression::kDeltaZstd}) {
    v1::Scan scan = RingScan();
    PointsToProto({}, &scan);
    DecodedScan decoded;
    EXPECT_TRUE(Decode(Compressed(scan, compression), decoded).ok());
    EXPECT_TRUE(decoded.points.empty());
  }
}

TEST(ScanCompression, RefusesWhatItDoesNotKnow) {
  v1::Scan scan = RingScan();
  scan.set_compression(static_cast<v1::ScanCompression>(4));
  EXPECT_THAT(Decode(scan),
              Refused("scan.compression", "scan.compression is 4, want a known compression"));
}

TEST(ScanCompression, RefusesAFrameOfAnotherSizeBeforeItIsInflated) {
  v1::Scan scan = Compressed(RingScan(), ScanCompression::kDeltaZstd);
  // A few bytes that would inflate to 10 MB.
  scan.set_points(wire::Compressed(std::string(10'000'000, '\0'), 1));
  EXPECT_THAT(Decode(scan),
              Refused("scan.points", "scan.points is a zstd frame of 10000000 bytes, want 7000"));
  scan.set_points("no frame");
  EXPECT_THAT(Decode(scan),
              Refused("scan.points", "scan.points is not a zstd frame, want one zstd frame"));
}

TEST(ScanCompression, BoundsWhatItInflatesByTheLimitOfAScan) {
  const v1::Scan scan = Compressed(RingScan(), ScanCompression::kDeltaZstd);
  const absl::Status status = Decode(scan, {.scan_bytes_max = 6999});
  EXPECT_THAT(status, Refused("scan.points",
                              "scan.points is 7000 bytes before they were compressed, want at "
                              "most 6999"));
  EXPECT_EQ(ReasonOf(status), ProblemReason::kTooLarge);
  EXPECT_TRUE(Decode(scan, {.scan_bytes_max = 7000}).ok());
  v1::Scan many = scan;
  many.set_point_count(std::numeric_limits<std::uint32_t>::max());
  EXPECT_EQ(FieldOf(Decode(many)), "scan.point_count");
}

TEST(ScanCompression, JudgesPointsAsIfTheyHadNotBeenCompressed) {
  v1::Scan scan = RingScan(/*int16=*/false);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  std::memcpy(scan.mutable_points()->data() + 3 * scan.point_stride() + 4, &nan, sizeof(nan));
  EXPECT_EQ(FieldOf(Decode(Compressed(scan, ScanCompression::kDeltaZstd))), "scan.points[3].y");
}

/// 64 x 48 pixels of a slope, coloured.
v1::Scan ImageScan() {
  static std::vector<std::uint16_t> depths(64 * 48);
  static std::vector<std::uint8_t> colors(depths.size() * 3, 77);
  for (std::size_t i = 0; i < depths.size(); ++i)
    depths[i] = static_cast<std::uint16_t>(2000 + i / 64);
  DepthImage image;
  image.width = 64;
  image.height = 48;
  image.fx_px = image.fy_px = 50;
  image.depth = std::as_bytes(std::span(depths));
  image.rgb = std::as_bytes(std::span(colors));
  v1::Scan scan = RingScan();
  for (const char* field : {"point_count", "point_stride", "fields", "points"})
    scan.GetReflection()->ClearField(&scan, scan.GetDescriptor()->FindFieldByName(field));
  ToProto(image, scan.mutable_depth_image());
  return scan;
}

TEST(ScanCompression, TakesDepthAndColoursOfAnImageEachForItself) {
  const v1::Scan plain = ImageScan();
  DecodedScan want, got;
  ASSERT_TRUE(Decode(plain, want).ok());
  ASSERT_EQ(want.points.size(), 64u * 48);
  // Differences between points are not for images: they get the plain kind.
  for (const auto compression : {ScanCompression::kZstd, ScanCompression::kDeltaZstd}) {
    const v1::Scan compressed = Compressed(plain, compression);
    EXPECT_EQ(compressed.compression(), v1::SCAN_COMPRESSION_ZSTD);
    EXPECT_LT(10 * PayloadBytes(compressed), PayloadBytes(plain));
    const absl::Status status = Decode(compressed, got);
    ASSERT_TRUE(status.ok()) << status;
    EXPECT_EQ(BytesOf(got.points), BytesOf(want.points));
  }
}

TEST(ScanCompression, RefusesImagesThatAreNotWhatTheySay) {
  v1::Scan scan = Compressed(ImageScan(), ScanCompression::kZstd);
  scan.mutable_depth_image()->set_width(65);
  EXPECT_THAT(Decode(scan), Refused("scan.depth_image.depth",
                                    "scan.depth_image.depth is a zstd frame of 6144 bytes, want "
                                    "6240"));
  scan = Compressed(ImageScan(), ScanCompression::kZstd);
  scan.mutable_depth_image()->set_rgb(scan.depth_image().depth());
  EXPECT_EQ(FieldOf(Decode(scan)), "scan.depth_image.rgb");
  scan = Compressed(ImageScan(), ScanCompression::kZstd);
  EXPECT_EQ(ReasonOf(Decode(scan, {.scan_bytes_max = 5 * 64 * 48 - 1})), ProblemReason::kTooLarge);
  scan.set_compression(v1::SCAN_COMPRESSION_DELTA_ZSTD);
  EXPECT_THAT(Decode(scan),
              Refused("scan.compression",
                      "scan.compression is SCAN_COMPRESSION_DELTA_ZSTD, want "
                      "SCAN_COMPRESSION_NONE or SCAN_COMPRESSION_ZSTD for a depth image"));
}

}  // namespace
}  // namespace gem::wire
