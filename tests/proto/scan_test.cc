#include "proto/wire/scan.h"

#include <cstring>
#include <limits>

#include "gem/v1/types.pb.h"
#include "tests/proto/refused.h"

namespace gem::wire {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

const std::vector<ScanPoint> kPoints = {{1, 2, 3, 0}, {-4, 5.5f, -6, 0}, {7, 8, 9, 0}};

v1::Scan GoodScan(const std::vector<ScanPoint>& points = kPoints) {
  v1::Scan scan;
  scan.set_seq(1);
  scan.set_stamp_ns(100);
  scan.set_sensor("top");
  PointsToProto(points, &scan);
  return scan;
}

absl::Status Decode(const v1::Scan& scan, DecodedScan& decoded, ScanLimits limits = {}) {
  return FromProto(scan, limits, FieldPath("scan"), decoded);
}

absl::Status Decode(const v1::Scan& scan, ScanLimits limits = {}) {
  DecodedScan decoded;
  return Decode(scan, decoded, limits);
}

TEST(ScanFromProto, DecodesFloatPoints) {
  DecodedScan decoded;
  ASSERT_TRUE(Decode(GoodScan(), decoded).ok());
  EXPECT_EQ(decoded.seq, 1u);
  EXPECT_EQ(decoded.stamp_ns, 100);
  EXPECT_EQ(decoded.sensor, "top");
  EXPECT_FALSE(decoded.T_O_B.has_value());
  EXPECT_FALSE(decoded.covariance.has_value());
  ASSERT_EQ(decoded.points.size(), 3u);
  EXPECT_EQ(decoded.points[1].x_m, -4);
  EXPECT_EQ(decoded.points[1].y_m, 5.5f);
  EXPECT_EQ(decoded.points[1].z_m, -6);
}

TEST(ScanFromProto, DecodesInt16PointsAtAThirdOfTheStride) {
  v1::Scan scan = GoodScan();
  ASSERT_TRUE(PointsToProtoInt16(kPoints, 0.005, &scan).ok());
  EXPECT_EQ(scan.point_stride(), 6u);
  DecodedScan decoded;
  ASSERT_TRUE(Decode(scan, decoded).ok());
  ASSERT_EQ(decoded.points.size(), 3u);
  EXPECT_NEAR(decoded.points[1].y_m, 5.5f, 1e-5);  // 1100 * 0.005
}

// Inflated bytes that a short string would hold in itself: views of them must survive a move.
TEST(ScanFromProto, LeavesInt16PointsAsTheyLieIfWanted) {
  const std::vector<ScanPoint> points = {{1, 2, 3, 0}, {-4, 5.5f, -6, 0}};
  for (const ScanCompression compression :
       {ScanCompression::kNone, ScanCompression::kZstd, ScanCompression::kDeltaZstd}) {
    v1::Scan scan = GoodScan();
    ASSERT_TRUE(PointsToProtoInt16(points, 0.005, &scan).ok());
    Compress(compression, &scan);
    DecodedScan decoded, left;
    ASSERT_TRUE(Decode(scan, decoded).ok());
    ASSERT_TRUE(FromProto(scan, {}, FieldPath("scan"), left, PointForm::kPacked).ok());
    const DecodedScan moved = std::move(left);
    EXPECT_EQ(moved.inflated != nullptr, compression != ScanCompression::kNone);
    EXPECT_TRUE(moved.points.empty());
    ASSERT_EQ(moved.packed.count, decoded.points.size());
    for (std::size_t i = 0; i < decoded.points.size(); ++i)
      EXPECT_EQ(PointAt(moved.packed, i).y_m, decoded.points[i].y_m);
  }
}

// What must be looked at before it is measured, or is more than coordinates, is decoded as ever.
TEST(ScanFromProto, LeavesOnlyPointsThatCannotBeOutOfRange) {
  const auto packed_count = [](const v1::Scan& scan) {
    DecodedScan decoded;
    EXPECT_TRUE(FromProto(scan, {}, FieldPath("scan"), decoded, PointForm::kPacked).ok());
    return decoded.packed.count;
  };
  v1::Scan scan = GoodScan();
  EXPECT_EQ(packed_count(scan), 0u);  // float32 may be NaN
  ASSERT_TRUE(PointsToProtoInt16(kPoints, 30, &scan).ok());
  EXPECT_EQ(packed_count(scan), 3u);
  ASSERT_TRUE(PointsToProtoInt16(kPoints, 31, &scan).ok());
  EXPECT_EQ(packed_count(scan), 0u);  // 32768 * 31 m is farther than a coordinate may be
  ASSERT_TRUE(PointsToProtoInt16(kPoints, 0.01, &scan, std::vector<float>{0, 0, 0.01f}).ok());
  EXPECT_EQ(packed_count(scan), 0u);
  const std::vector<ScanPoint> red = {{1, 2, 3, 0xff0000ffu}};
  ASSERT_TRUE(PointsToProtoInt16(red, 0.01, &scan).ok());
  EXPECT_EQ(packed_count(scan), 0u);
}

TEST(ScanFromProto, Int16PointsKeepTheirColours) {
  const std::vector<ScanPoint> points = {{1, 2, 3, 0xff0000ffu}, {4, 5, 6, 0}};
  const std::vector<float> offsets_s = {-0.05f, 0.05f};
  v1::Scan scan = GoodScan();
  ASSERT_TRUE(PointsToProtoInt16(points, 0.01, &scan, offsets_s).ok());
  EXPECT_EQ(scan.point_stride(), 14u);
  DecodedScan decoded;
  ASSERT_TRUE(Decode(scan, decoded).ok());
  ASSERT_EQ(decoded.points.size(), 2u);
  EXPECT_EQ(decoded.points[0].rgba, 0xff0000ffu);
  EXPECT_EQ(decoded.points[1].rgba, 0u);
  EXPECT_NEAR(decoded.points[1].z_m, 6, 1e-6);
  EXPECT_EQ(decoded.time_offsets_s, offsets_s);
}

TEST(ScanFromProto, RefusesToSendAPointThatInt16CannotHold) {
  v1::Scan scan;
  EXPECT_THAT(PointsToProtoInt16(std::vector<ScanPoint>{{0, 0, 400, 0}}, 0.01, &scan),
              Refused("points[0].z", "points[0].z is 400, want at most 327.67 in magnitude"));
}

TEST(ScanFromProto, KeepsColoursAndTellsNoneFromBlack) {
  DecodedScan decoded;
  ASSERT_TRUE(
      Decode(GoodScan({{1, 2, 3, 0xff000000}, {1, 2, 3, 0x00ffffff}, {1, 2, 3, 0x80000001}}),
             decoded)
          .ok());
  EXPECT_EQ(decoded.points[0].rgba, 0xff000000u);  // black
  EXPECT_EQ(decoded.points[1].rgba, 0u);           // alpha 0: no colour
  EXPECT_EQ(decoded.points[2].rgba, 0xff000001u);
}

TEST(ScanFromProto, ReadsFieldsWhereTheyLieAndIgnoresOthers) {
  // 20 bytes a point: intensity, then z, y, x.
  v1::Scan scan = GoodScan();
  scan.clear_fields();
  const auto add = [&](const char* name, std::uint32_t offset, v1::PointField::Type type) {
    v1::PointField* field = scan.add_fields();
    field->set_name(name);
    field->set_offset(offset);
    field->set_type(type);
  };
  add("intensity", 0, v1::PointField::TYPE_UINT16);
  add("z", 4, v1::PointField::TYPE_FLOAT32);
  add("y", 8, v1::PointField::TYPE_FLOAT32);
  add("x", 16, v1::PointField::TYPE_FLOAT32);
  const float values[5] = {99, 3, 2, 98, 1};
  scan.set_points(std::string(reinterpret_cast<const char*>(values), sizeof(values)));
  scan.set_point_count(1);
  scan.set_point_stride(20);
  DecodedScan decoded;
  ASSERT_TRUE(Decode(scan, decoded).ok());
  EXPECT_EQ(decoded.points[0].x_m, 1);
  EXPECT_EQ(decoded.points[0].y_m, 2);
  EXPECT_EQ(decoded.points[0].z_m, 3);
}

TEST(ScanFromProto, RefusesTruncatedPoints) {
  v1::Scan scan = GoodScan();
  scan.mutable_points()->pop_back();
  EXPECT_THAT(Decode(scan),
              Refused("scan.points",
                      "scan.points is 35 bytes, want point_count * point_stride = 3 * "
                      "12 = 36"));
}

TEST(ScanFromProto, RefusesASizeThatOnlyFitsModulo32Bits) {
  v1::Scan scan = GoodScan();
  scan.set_point_count(0x55555556);  // * 12 = 2^34 + 8, which is 8 in 32 bits
  scan.set_points(std::string(8, '\0'));
  ScanLimits limits;
  limits.points_max = 0xffffffff;
  EXPECT_EQ(FieldOf(Decode(scan, limits)), "scan.points");
}

TEST(ScanFromProto, RefusesWrongStrides) {
  v1::Scan scan = GoodScan();
  scan.set_point_stride(5);
  EXPECT_THAT(Decode(scan), Refused("scan.point_stride", "scan.point_stride is 5, want 6 to 256"));
  scan.set_point_stride(257);
  EXPECT_THAT(Decode(scan),
              Refused("scan.point_stride", "scan.point_stride is 257, want 6 to 256"));
  scan.set_point_stride(16);  // fits the fields, not the bytes
  EXPECT_EQ(FieldOf(Decode(scan)), "scan.points");
  scan.set_point_stride(10);  // z ends at 12
  EXPECT_THAT(Decode(scan),
              Refused("scan.fields[2].offset",
                      "scan.fields[2].offset is 8, want at most point_stride - width = 10 - 4"));
}

TEST(ScanFromProto, RefusesAnOffsetThatWouldWrapRound) {
  v1::Scan scan = GoodScan();
  scan.mutable_fields(0)->set_offset(0xfffffffe);
  EXPECT_EQ(FieldOf(Decode(scan)), "scan.fields[0].offset");
}

TEST(ScanFromProto, RefusesMoreThanTheLimits) {
  const absl::Status bytes = Decode(GoodScan(), {.scan_bytes_max = 35, .points_max = 3});
  EXPECT_THAT(bytes, Refused("scan.points", "scan.points is 36 bytes, want at most 35"));
  EXPECT_EQ(ReasonOf(bytes), ProblemReason::kTooLarge);
  const absl::Status points = Decode(GoodScan(), {.scan_bytes_max = 36, .points_max = 2});
  EXPECT_THAT(points, Refused("scan.point_count", "scan.point_count is 3, want at most 2"));
  EXPECT_EQ(ReasonOf(points), ProblemReason::kTooLarge);
  EXPECT_TRUE(Decode(GoodScan(), {.scan_bytes_max = 36, .points_max = 3}).ok());
}

TEST(ScanFromProto, TakesAScanThatSawNothing) {
  DecodedScan decoded;
  decoded.points.resize(3);
  EXPECT_TRUE(Decode(GoodScan({}), decoded).ok());
  EXPECT_TRUE(decoded.points.empty());
}

TEST(ScanFromProto, WantsPointsOrADepthImage) {
  v1::Scan scan;
  scan.set_sensor("top");
  EXPECT_THAT(Decode(scan), Refused("scan.points",
                                    "scan.points is without a layout and depth_image is unset, "
                                    "want one of the two"));
  scan = GoodScan();
  scan.mutable_depth_image();
  EXPECT_THAT(Decode(scan), Refused("scan.depth_image",
                                    "scan.depth_image is set and points are, too, want one of the "
                                    "two"));
  scan = GoodScan({});
  scan.mutable_depth_image();
  EXPECT_EQ(FieldOf(Decode(scan)), "scan.depth_image");
}

TEST(ScanFromProto, ReadsTimeOffsetsInSecondsAndNanoseconds) {
  v1::Scan scan = GoodScan();
  const std::vector<float> offsets_s = {-0.05f, 0, 0.025f};
  PointsToProto(kPoints, &scan, offsets_s);
  EXPECT_EQ(scan.point_stride(), 16u);
  DecodedScan decoded;
  ASSERT_TRUE(Decode(scan, decoded).ok());
  EXPECT_EQ(decoded.time_offsets_s, offsets_s);
  EXPECT_EQ(decoded.points[1].y_m, 5.5f);
  ASSERT_TRUE(PointsToProtoInt16(kPoints, 0.01, &scan, offsets_s).ok());
  EXPECT_EQ(scan.point_stride(), 10u);
  ASSERT_TRUE(Decode(scan, decoded).ok());
  EXPECT_EQ(decoded.time_offsets_s, offsets_s);
  EXPECT_NEAR(decoded.points[1].y_m, 5.5f, 1e-5);

  // As an Ouster says it: "t", nanoseconds.
  PointsToProto(kPoints, &scan, offsets_s);
  scan.mutable_fields(3)->set_name("t");
  scan.mutable_fields(3)->set_type(v1::PointField::TYPE_UINT32);
  for (std::uint32_t i = 0; i < 3; ++i) {
    const std::uint32_t ns = i * 50'000'000;
    std::memcpy(scan.mutable_points()->data() + 16 * i + 12, &ns, sizeof(ns));
  }
  ASSERT_TRUE(Decode(scan, decoded).ok());
  EXPECT_EQ(decoded.time_offsets_s, (std::vector<float>{0, 0.05f, 0.1f}));

  // The buffer does not keep them for a scan without.
  ASSERT_TRUE(Decode(GoodScan(), decoded).ok());
  EXPECT_TRUE(decoded.time_offsets_s.empty());
}

TEST(ScanFromProto, RefusesTimeOffsetsThatCannotBe) {
  v1::Scan scan = GoodScan();
  PointsToProto(kPoints, &scan, std::vector<float>{0, 1.5f, 0});
  EXPECT_THAT(Decode(scan), Refused("scan.points[1].time_offset",
                                    "scan.points[1].time_offset is 1.5, want at most 1 s in "
                                    "magnitude"));
  PointsToProto(kPoints, &scan, std::vector<float>{0, 0, kNan});
  EXPECT_THAT(Decode(scan), Refused("scan.points[2].time_offset",
                                    "scan.points[2].time_offset is nan, want at most 1 s in "
                                    "magnitude"));
  scan.mutable_fields(3)->set_type(v1::PointField::TYPE_UINT32);
  const std::uint32_t ns = 4'000'000'000;  // negative, if it were signed
  std::memcpy(scan.mutable_points()->data() + 12, &ns, sizeof(ns));
  EXPECT_THAT(Decode(scan), Refused("scan.points[0].time_offset",
                                    "scan.points[0].time_offset is 4, want at most 1 s in "
                                    "magnitude"));
  scan.mutable_fields(3)->set_type(v1::PointField::TYPE_INT16);
  EXPECT_THAT(Decode(scan), Refused("scan.fields[3].type",
                                    "scan.fields[3].type is TYPE_INT16, want TYPE_FLOAT32 or "
                                    "TYPE_UINT32 for time_offset"));
  // Both names mean the same.
  PointsToProto(kPoints, &scan, std::vector<float>{0, 0, 0});
  *scan.add_fields() = scan.fields(3);
  scan.mutable_fields(4)->set_name("t");
  EXPECT_EQ(FieldOf(Decode(scan)), "scan.fields[4].name");
}

TEST(ScanFromProto, NamesThePointAndTheAxisThatIsNotFinite) {
  std::vector<ScanPoint> points(20, ScanPoint{1, 2, 3, 0});
  points[17].x_m = kNan;
  EXPECT_THAT(Decode(GoodScan(points)),
              Refused("scan.points[17].x", "scan.points[17].x is nan, want a finite number"));
  points[17] = {1, 2, std::numeric_limits<float>::infinity(), 0};
  EXPECT_THAT(Decode(GoodScan(points)),
              Refused("scan.points[17].z", "scan.points[17].z is inf, want a finite number"));
  points[17] = {1, 3e38f, 0, 0};
  EXPECT_THAT(
      Decode(GoodScan(points)),
      Refused("scan.points[17].y", "scan.points[17].y is 3e+38, want at most 1e+06 in magnitude"));
}

TEST(ScanFromProto, RefusesFieldsThatDoNotDescribeAPoint) {
  v1::Scan scan = GoodScan();
  scan.mutable_fields()->RemoveLast();
  EXPECT_THAT(Decode(scan), Refused("scan.fields", "scan.fields is 2 fields, want 3 to 16"));

  scan = GoodScan();
  scan.mutable_fields(2)->set_name("height");
  EXPECT_THAT(Decode(scan),
              Refused("scan.fields", "scan.fields is without \"z\", want x, y and z once each"));

  scan = GoodScan();
  scan.mutable_fields(2)->set_name("x");
  EXPECT_THAT(Decode(scan), Refused("scan.fields[2].name",
                                    "scan.fields[2].name is \"x\" for the second time, want each "
                                    "name once"));

  scan = GoodScan();
  scan.mutable_fields(1)->set_type(v1::PointField::TYPE_UINT32);
  EXPECT_THAT(Decode(scan),
              Refused("scan.fields[1].type",
                      "scan.fields[1].type is TYPE_UINT32, want TYPE_FLOAT32 or TYPE_INT16 for y"));

  scan = GoodScan();
  scan.mutable_fields(1)->set_type(static_cast<v1::PointField::Type>(77));
  EXPECT_THAT(Decode(scan),
              Refused("scan.fields[1].type", "scan.fields[1].type is 77, want a known type"));
  scan.mutable_fields(1)->set_type(v1::PointField::TYPE_UNSPECIFIED);
  EXPECT_EQ(FieldOf(Decode(scan)), "scan.fields[1].type");

  scan = GoodScan({{1, 2, 3, 0xff0000ff}});
  scan.mutable_fields(3)->set_type(v1::PointField::TYPE_FLOAT32);
  EXPECT_THAT(Decode(scan),
              Refused("scan.fields[3].type",
                      "scan.fields[3].type is TYPE_FLOAT32, want TYPE_UINT32 for rgba"));
}

TEST(ScanFromProto, RefusesScalesThatMeanNothing) {
  v1::Scan scan = GoodScan();
  scan.mutable_fields(0)->set_scale(2);
  EXPECT_THAT(Decode(scan), Refused("scan.fields[0].scale",
                                    "scan.fields[0].scale is 2, want 0 for TYPE_FLOAT32"));
  ASSERT_TRUE(PointsToProtoInt16(kPoints, 0.01, &scan).ok());
  scan.mutable_fields(1)->set_scale(kNan);
  EXPECT_THAT(Decode(scan), Refused("scan.fields[1].scale",
                                    "scan.fields[1].scale is nan, want 0 (means 1) to 1000"));
  scan.mutable_fields(1)->set_scale(-1);
  EXPECT_EQ(FieldOf(Decode(scan)), "scan.fields[1].scale");
}

TEST(ScanFromProto, RefusesAPoseByItsField) {
  v1::Scan scan = GoodScan();
  scan.mutable_odom_from_base();
  EXPECT_EQ(FieldOf(Decode(scan)), "scan.odom_from_base");
  scan.mutable_odom_from_base()->set_qw(1);
  scan.mutable_odom_from_base()->set_z(kNan);
  EXPECT_THAT(Decode(scan), Refused("scan.odom_from_base.z",
                                    "scan.odom_from_base.z is nan, want a finite number"));
}

TEST(ScanFromProto, RefusesStampsAndSensorNames) {
  v1::Scan scan = GoodScan();
  scan.set_stamp_ns(-5);
  EXPECT_THAT(Decode(scan),
              Refused("scan.stamp_ns", "scan.stamp_ns is -5, want 0 to 4000000000000000000"));
  scan = GoodScan();
  scan.set_sensor("");
  EXPECT_EQ(FieldOf(Decode(scan)), "scan.sensor");
}

TEST(ScanFromProto, SplitsTheCovariance) {
  v1::Scan scan = GoodScan();
  PoseCovariance covariance;
  covariance.translation_m2 << 4, 1, 0, 1, 5, 2, 0, 2, 6;
  covariance.rotation_rad2 << 0.3, 0, 0.1, 0, 0.2, 0, 0.1, 0, 0.4;
  CovarianceToProto(covariance, &scan);
  ASSERT_EQ(scan.pose_covariance_size(), 21);
  EXPECT_FLOAT_EQ(scan.pose_covariance(7), 2);      // (1, 2)
  EXPECT_FLOAT_EQ(scan.pose_covariance(17), 0.1f);  // (3, 5)
  DecodedScan decoded;
  ASSERT_TRUE(Decode(scan, decoded).ok());
  ASSERT_TRUE(decoded.covariance.has_value());
  EXPECT_TRUE(decoded.covariance->translation_m2.isApprox(covariance.translation_m2, 1e-6));
  EXPECT_TRUE(decoded.covariance->rotation_rad2.isApprox(covariance.rotation_rad2, 1e-6));
}

TEST(ScanFromProto, RefusesACovarianceThatIsNone) {
  v1::Scan scan = GoodScan();
  for (int i = 0; i < 20; ++i) scan.add_pose_covariance(0);
  EXPECT_THAT(Decode(scan), Refused("scan.pose_covariance",
                                    "scan.pose_covariance is 20 values, want 21 or none"));
  scan.add_pose_covariance(-1);
  EXPECT_THAT(Decode(scan),
              Refused("scan.pose_covariance[20]",
                      "scan.pose_covariance[20] is -1, want at least 0 on the diagonal"));
  scan.set_pose_covariance(20, kNan);
  EXPECT_EQ(FieldOf(Decode(scan)), "scan.pose_covariance[20]");
  scan.set_pose_covariance(20, 0);
  scan.set_pose_covariance(1, 1);  // covariance of x and y without any variance of theirs
  EXPECT_EQ(FieldOf(Decode(scan)), "scan.pose_covariance");
}

TEST(ScanFromProto, ReusesTheBufferOfTheScanBefore) {
  DecodedScan decoded;
  ASSERT_TRUE(Decode(GoodScan(), decoded).ok());
  const ScanPoint* buffer = decoded.points.data();
  ASSERT_TRUE(Decode(GoodScan({{1, 1, 1, 0}}), decoded).ok());
  EXPECT_EQ(decoded.points.data(), buffer);
  EXPECT_EQ(decoded.points.size(), 1u);
}

}  // namespace
}  // namespace gem::wire
