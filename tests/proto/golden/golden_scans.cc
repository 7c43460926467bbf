#include <cmath>
#include <span>
#include <string>
#include <vector>

#include "core/base/check.h"
#include "gem/v1/types.pb.h"
#include "proto/wire/depth_image.h"
#include "proto/wire/scan.h"
#include "proto/wire/scan_codec.h"
#include "proto/wire/zstd_frame.h"
#include "tests/proto/golden/golden_cases.h"
#include "tests/proto/golden/golden_file.h"

namespace gem::golden {
namespace {

using wire::ScanCompression;

/// A piece of a ring on the ground; every third point has no colour.
std::vector<ScanPoint> Ring(bool colored) {
  std::vector<ScanPoint> points;
  for (int i = 0; i < 8; ++i) {
    const float angle = 0.02f * static_cast<float>(i);
    const Rgba color = colored && i % 3 != 0 ? 0xff804000u | static_cast<Rgba>(i) : 0;
    points.push_back({5 * std::cos(angle), 5 * std::sin(angle), -1.7f, color});
  }
  return points;
}

v1::Scan Head() {
  v1::Scan scan;
  scan.set_seq(1);
  scan.set_stamp_ns(1'700'000'000'000'000'000);
  scan.set_sensor("top");
  return scan;
}

/// What a frame, or bytes without one, hold.
std::string Opened(const std::string& bytes, std::size_t size, const v1::Scan& scan) {
  if (scan.compression() == v1::SCAN_COMPRESSION_UNSPECIFIED) return bytes;
  return *wire::Inflated(bytes, size, wire::FieldPath("frame"));
}

ScanCase& AddCase(const std::string& name, const std::string& shows, const v1::Scan& scan,
                  Scans* scans) {
  ScanCase& result = *scans->add_cases();
  result.set_name(name);
  result.set_shows(shows);
  *result.mutable_scan() = scan;
  wire::DecodedScan decoded;
  GEM_CHECK(wire::FromProto(scan, {}, wire::FieldPath("scan"), decoded).ok());
  bool colored = false;
  for (const ScanPoint& point : decoded.points) {
    auto* xyz = result.mutable_points()->add_values()->mutable_list_value();
    for (const float value : {point.x_m, point.y_m, point.z_m}) AddNumber(value, xyz);
    colored |= point.rgba != 0;
  }
  for (const ScanPoint& point : decoded.points) {
    if (!colored) break;
    auto* color = result.mutable_colors()->add_values();
    color->set_null_value(google::protobuf::NULL_VALUE);
    for (int channel = 0; point.rgba != 0 && channel < 3; ++channel)
      color->mutable_list_value()->add_values()->set_number_value((point.rgba >> (8 * channel)) &
                                                                  0xff);
  }
  for (const float offset_s : decoded.time_offsets_s)
    AddNumber(offset_s, result.mutable_time_offsets_s());
  return result;
}

void AddPoints(const std::string& name, const std::string& shows, v1::Scan scan,
               ScanCompression compression, Scans* scans) {
  const std::string packed = scan.points();
  wire::Compress(compression, &scan);
  ScanCase& result = AddCase(name, shows, scan, scans);
  result.set_points_hex(Hex(packed));
  result.set_frame_hex(Hex(Opened(scan.points(), packed.size(), scan)));
}

void AddDepthImage(const std::string& name, const std::string& shows, const DepthImage& image,
                   ScanCompression compression, Scans* scans) {
  v1::Scan scan = Head();
  wire::ToProto(image, scan.mutable_depth_image());
  const std::string depth = scan.depth_image().depth();
  const std::string rgb = scan.depth_image().rgb();
  wire::Compress(compression, &scan);
  ScanCase& result = AddCase(name, shows, scan, scans);
  result.set_depth_hex(Hex(depth));
  result.set_rgb_hex(Hex(rgb));
}

void AddFloat32(Scans* scans) {
  v1::Scan scan = Head();
  wire::PointsToProto(Ring(/*colored=*/false), &scan);
  AddPoints("float32", "x, y and z one behind the other", scan, ScanCompression::kNone, scans);
  AddPoints("float32_delta", "float32 is treated as the 32 bits that it is", scan,
            ScanCompression::kDeltaZstd, scans);
  std::vector<float> offsets_s;
  for (int i = 0; i < 8; ++i) offsets_s.push_back(-0.05f + 0.01f * static_cast<float>(i));
  wire::PointsToProto(Ring(/*colored=*/true), &scan, offsets_s);
  AddPoints("float32_all_fields", "colours (alpha 0: none) and time offsets", scan,
            ScanCompression::kZstd, scans);
  wire::PointsToProto({}, &scan);
  AddPoints("nothing_seen", "a scan without points: a frame of no bytes", scan,
            ScanCompression::kDeltaZstd, scans);
}

void AddInt16(Scans* scans) {
  v1::Scan scan = Head();
  GEM_CHECK(wire::PointsToProtoInt16(Ring(/*colored=*/false), 0.004, &scan).ok());
  AddPoints("int16", "value = raw * scale", scan, ScanCompression::kNone, scans);
  AddPoints("int16_delta", "differences, zigzag, byte by byte in planes, a frame", scan,
            ScanCompression::kDeltaZstd, scans);
}

/// A driver's layout: bytes that no field names, and a field over another one.
void AddOddLayout(Scans* scans) {
  v1::Scan scan = Head();
  const auto field = [&](const char* name, std::uint32_t offset, v1::PointField::Type type,
                         double scale) {
    v1::PointField* added = scan.add_fields();
    added->set_name(name);
    added->set_offset(offset);
    added->set_type(type);
    added->set_scale(scale);
  };
  field("z", 6, v1::PointField::TYPE_INT16, 0.01);
  field("x", 0, v1::PointField::TYPE_INT16, 0.01);
  field("y", 2, v1::PointField::TYPE_INT16, 0.01);
  field("ring", 10, v1::PointField::TYPE_UINT8, 0);
  field("t", 12, v1::PointField::TYPE_UINT32, 0);
  field("both", 4, v1::PointField::TYPE_UINT32, 0);  // over z: ignored
  const std::uint32_t stride = 17;
  std::string points;
  for (int i = 0; i < 4 * 17; ++i) points.push_back(static_cast<char>(i * i * 5 + i / 17));
  // Nanoseconds: below 1 s.
  for (std::size_t i = 0; i < 4; ++i) points[i * stride + 15] = '\x01';
  scan.set_point_count(4);
  scan.set_point_stride(stride);
  scan.set_points(points);
  AddPoints("odd_layout", "padding, fields in any order, one over another, nanoseconds", scan,
            ScanCompression::kDeltaZstd, scans);
}

void AddDepthImages(Scans* scans) {
  const std::vector<std::uint16_t> depths = {1000, 0, 2000, 65535, 1500, 1501};
  const std::vector<std::uint8_t> colors = {1,  2,  3,  4,  5,  6,  7,  8,  9,
                                            10, 11, 12, 13, 14, 15, 16, 17, 18};
  DepthImage image;
  image.width = 3;
  image.height = 2;
  image.fx_px = 2;
  image.fy_px = 4;
  image.cx_px = 1;
  image.cy_px = 0.5;
  image.depth = std::as_bytes(std::span(depths));
  image.rgb = std::as_bytes(std::span(colors));
  AddDepthImage("depth_uint16", "millimetres, 0 is no measurement; colours", image,
                ScanCompression::kNone, scans);
  AddDepthImage("depth_uint16_frames", "a frame of depths and a frame of colours", image,
                ScanCompression::kZstd, scans);
  const std::vector<float> depths_m = {1, 0, -1, std::nanf(""), 2, 1001};
  image.encoding = DepthEncoding::kFloat32;
  image.depth = std::as_bytes(std::span(depths_m));
  image.rgb = {};
  AddDepthImage("depth_float32",
                "what is not above 0, not finite or beyond 1000 m is no measurement", image,
                ScanCompression::kZstd, scans);
  image.step = 2;
  AddDepthImage("depth_step", "every second pixel of every second row", image,
                ScanCompression::kNone, scans);
}

}  // namespace

Scans MakeScans() {
  Scans scans;
  AddFloat32(&scans);
  AddInt16(&scans);
  AddOddLayout(&scans);
  AddDepthImages(&scans);
  return scans;
}

}  // namespace gem::golden
