#include "proto/wire/scan.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <memory>
#include <span>
#include <utility>

#include "absl/strings/str_cat.h"
#include "core/base/status_macros.h"
#include "gem/v1/types.pb.h"
#include "proto/wire/depth_image.h"
#include "proto/wire/point_decoding.h"
#include "proto/wire/point_layout.h"
#include "proto/wire/pose.h"
#include "proto/wire/refusal.h"
#include "proto/wire/scalar.h"
#include "proto/wire/scan_codec.h"
#include "proto/wire/zstd_frame.h"

namespace gem::wire {
namespace {

constexpr int kCovarianceValues = 21;
constexpr float kCovarianceMax = 1e6f;
/// Higher levels take 3 % less for twice the time.
constexpr int kZstdLevel = 1;

absl::StatusOr<ScanCompression> CompressionFromProto(const v1::Scan& proto,
                                                     const FieldPath& field) {
  switch (proto.compression()) {
    case v1::SCAN_COMPRESSION_UNSPECIFIED:
    case v1::SCAN_COMPRESSION_NONE:
      return ScanCompression::kNone;
    case v1::SCAN_COMPRESSION_ZSTD:
      return ScanCompression::kZstd;
    case v1::SCAN_COMPRESSION_DELTA_ZSTD:
      if (!proto.has_depth_image()) return ScanCompression::kDeltaZstd;
      return Refuse(field, "SCAN_COMPRESSION_DELTA_ZSTD",
                    "SCAN_COMPRESSION_NONE or SCAN_COMPRESSION_ZSTD for a depth image");
    default:
      return Refuse(field, absl::StrCat(static_cast<int>(proto.compression())),
                    "a known compression");
  }
}

/// All that can be known of the size without touching the points.
absl::Status CheckSize(const v1::Scan& proto, bool compressed, const ScanLimits& limits,
                       const FieldPath& field) {
  const FieldPath points = field.Child("points");
  const std::uint64_t bytes = proto.points().size();
  const auto too_large = [&](const std::string& what) {
    return Refuse(points, what, absl::StrCat("at most ", limits.scan_bytes_max),
                  ProblemReason::kTooLarge);
  };
  if (bytes > limits.scan_bytes_max) return too_large(absl::StrCat(bytes, " bytes"));
  if (proto.point_count() > limits.points_max)
    return Refuse(field.Child("point_count"), absl::StrCat(proto.point_count()),
                  absl::StrCat("at most ", limits.points_max), ProblemReason::kTooLarge);
  const std::uint64_t wanted = std::uint64_t{proto.point_count()} * proto.point_stride();
  if (compressed)
    return wanted <= limits.scan_bytes_max
               ? absl::OkStatus()
               : too_large(absl::StrCat(wanted, " bytes before they were compressed"));
  if (bytes != wanted)
    return Refuse(points, absl::StrCat(bytes, " bytes"),
                  absl::StrCat("point_count * point_stride = ", proto.point_count(), " * ",
                               proto.point_stride(), " = ", wanted));
  return absl::OkStatus();
}

/// The points as the driver packed them: those of `proto`, or `inflated`. The layout was checked.
absl::StatusOr<absl::string_view> PointBytes(const v1::Scan& proto, ScanCompression compression,
                                             const ScanLimits& limits, const FieldPath& field,
                                             std::unique_ptr<const std::string>& inflated) {
  GEM_RETURN_IF_ERROR(CheckSize(proto, compression != ScanCompression::kNone, limits, field));
  if (compression == ScanCompression::kNone) return absl::string_view(proto.points());
  const std::size_t bytes = std::size_t{proto.point_count()} * proto.point_stride();
  GEM_ASSIGN_OR_RETURN(std::string buffer, Inflated(proto.points(), bytes, field.Child("points")));
  if (compression == ScanCompression::kDeltaZstd)
    buffer = DecodeDeltas(buffer, proto.point_stride(), PointColumnsOf(proto));
  inflated = std::make_unique<const std::string>(std::move(buffer));
  return absl::string_view(*inflated);
}

/// Position of (row, column) of the upper triangle of a 6x6 matrix by rows; row <= column.
constexpr int TriangleIndex(int row, int column) {
  return row * 6 - row * (row - 1) / 2 + column - row;
}
static_assert(TriangleIndex(5, 5) == kCovarianceValues - 1);

absl::Status CheckPositiveSemidefinite(const Eigen::Matrix3d& covariance, const char* what,
                                       const FieldPath& field) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(covariance, Eigen::EigenvaluesOnly);
  const double smallest = solver.eigenvalues().minCoeff();
  // Floats of the wire may make an eigenvalue that is zero slightly negative.
  if (smallest >= -1e-5 * covariance.trace()) return absl::OkStatus();
  return Refuse(field, absl::StrCat("a matrix whose ", what, " part has the eigenvalue ", smallest),
                "a positive semidefinite matrix");
}

absl::StatusOr<PoseCovariance> CovarianceFromProto(const v1::Scan& proto, const FieldPath& field) {
  if (proto.pose_covariance_size() != kCovarianceValues)
    return Refuse(field, absl::StrCat(proto.pose_covariance_size(), " values"),
                  absl::StrCat(kCovarianceValues, " or none"));
  for (int i = 0; i < kCovarianceValues; ++i) {
    const FieldPath element = field.At(static_cast<std::size_t>(i));
    const float value = proto.pose_covariance(i);
    GEM_RETURN_IF_ERROR(CheckFinite(value, element));
    if (std::abs(value) > kCovarianceMax)
      return Refuse(element, value, absl::StrCat("at most ", kCovarianceMax, " in magnitude"));
  }
  for (int row = 0; row < 6; ++row) {
    const int diagonal = TriangleIndex(row, row);
    if (proto.pose_covariance(diagonal) < 0)
      return Refuse(field.At(static_cast<std::size_t>(diagonal)), proto.pose_covariance(diagonal),
                    "at least 0 on the diagonal");
  }
  PoseCovariance covariance;
  for (int row = 0; row < 3; ++row)
    for (int column = row; column < 3; ++column) {
      const double translation = proto.pose_covariance(TriangleIndex(row, column));
      const double rotation = proto.pose_covariance(TriangleIndex(row + 3, column + 3));
      covariance.translation_m2(row, column) = covariance.translation_m2(column, row) = translation;
      covariance.rotation_rad2(row, column) = covariance.rotation_rad2(column, row) = rotation;
    }
  GEM_RETURN_IF_ERROR(CheckPositiveSemidefinite(covariance.translation_m2, "translation", field));
  GEM_RETURN_IF_ERROR(CheckPositiveSemidefinite(covariance.rotation_rad2, "rotation", field));
  return covariance;
}

/// True if any field of a scan of points is set: a scan that saw nothing still has a layout.
bool HasPoints(const v1::Scan& proto) {
  return proto.point_count() != 0 || proto.point_stride() != 0 || proto.fields_size() != 0 ||
         !proto.points().empty();
}

absl::Status PayloadFromProto(const v1::Scan& proto, const ScanLimits& limits,
                              const FieldPath& field, PointForm form, DecodedScan& scan) {
  if (HasPoints(proto) == proto.has_depth_image())
    return proto.has_depth_image()
               ? Refuse(field.Child("depth_image"), "set and points are, too", "one of the two")
               : Refuse(field.Child("points"), "without a layout and depth_image is unset",
                        "one of the two");
  GEM_ASSIGN_OR_RETURN(const ScanCompression compression,
                       CompressionFromProto(proto, field.Child("compression")));
  if (proto.has_depth_image()) {
    const FieldPath image_field = field.Child("depth_image");
    InflatedPixels pixels;
    GEM_ASSIGN_OR_RETURN(
        const DepthImage image,
        compression == ScanCompression::kNone
            ? FromProto(proto.depth_image(), limits, image_field)
            : FromCompressedProto(proto.depth_image(), limits, image_field, pixels));
    Unproject(image, scan.points);
    scan.time_offsets_s.clear();
    return absl::OkStatus();
  }
  GEM_ASSIGN_OR_RETURN(const PointLayout layout, LayoutFromProto(proto, field));
  GEM_ASSIGN_OR_RETURN(const absl::string_view bytes,
                       PointBytes(proto, compression, limits, field, scan.inflated));
  if (form == PointForm::kPacked) {
    if (const std::optional<PackedPoints> packed = AsPacked(bytes, layout)) {
      scan.points.clear();
      scan.time_offsets_s.clear();
      scan.packed = *packed;
      return absl::OkStatus();
    }
  }
  GEM_RETURN_IF_ERROR(DecodePoints(bytes, layout, field, scan.points));
  return DecodeTimeOffsets(bytes, layout, field, scan.time_offsets_s);
}

v1::PointField* AddField(const char* name, std::uint32_t offset, v1::PointField::Type type,
                         v1::Scan* proto) {
  v1::PointField* field = proto->add_fields();
  field->set_name(name);
  field->set_offset(offset);
  field->set_type(type);
  return field;
}

/// Room for the points; returns where the first one goes.
char* ResizePoints(std::size_t num_points, std::uint32_t stride, v1::Scan* proto) {
  proto->set_point_count(static_cast<std::uint32_t>(num_points));
  proto->set_point_stride(stride);
  proto->clear_compression();
  proto->mutable_points()->resize(num_points * stride);
  return proto->mutable_points()->data();
}

}  // namespace

absl::Status FromProto(const v1::Scan& proto, const ScanLimits& limits, const FieldPath& field,
                       DecodedScan& scan, PointForm form) {
  scan.seq = proto.seq();
  scan.stamp_ns = proto.stamp_ns();
  scan.T_O_B.reset();
  scan.covariance.reset();
  scan.packed = {};
  scan.inflated.reset();
  GEM_RETURN_IF_ERROR(CheckStamp(proto.stamp_ns(), field.Child("stamp_ns")));
  GEM_RETURN_IF_ERROR(CheckId(proto.sensor(), field.Child("sensor")));
  scan.sensor = proto.sensor();
  if (proto.has_odom_from_base()) {
    auto T_O_B = FromProto<Odom, Base>(proto.odom_from_base(), field.Child("odom_from_base"));
    if (!T_O_B.ok()) return T_O_B.status();
    scan.T_O_B = *T_O_B;
  }
  if (proto.pose_covariance_size() != 0) {
    auto covariance = CovarianceFromProto(proto, field.Child("pose_covariance"));
    if (!covariance.ok()) return covariance.status();
    scan.covariance = *covariance;
  }
  return PayloadFromProto(proto, limits, field, form, scan);
}

std::uint64_t PayloadBytes(const v1::Scan& proto) {
  return std::uint64_t{proto.points().size()} + proto.depth_image().depth().size() +
         proto.depth_image().rgb().size();
}

namespace {

/// Where the values of a point lie when they are sent: xyz, then colour and time offset where there
/// are any.
struct PointStride {
  PointStride(std::span<const ScanPoint> points, std::uint32_t xyz_bytes, bool timed)
      : rgba(xyz_bytes),
        time_offset(rgba + (HasColors(points) ? 4 : 0)),
        bytes(time_offset + (timed ? 4 : 0)) {}

  bool colored() const { return time_offset != rgba; }
  bool timed() const { return bytes != time_offset; }

  /// Adds the fields that follow xyz.
  void AddFields(v1::Scan* proto) const {
    if (colored()) AddField(kColorName, rgba, v1::PointField::TYPE_UINT32, proto);
    if (timed()) AddField(kTimeOffsetName, time_offset, v1::PointField::TYPE_FLOAT32, proto);
  }
  void WriteBehindXyz(const ScanPoint& point, std::span<const float> time_offsets_s, std::size_t i,
                      char* to) const {
    if (colored()) std::memcpy(to + rgba, &point.rgba, sizeof(point.rgba));
    if (timed()) std::memcpy(to + time_offset, &time_offsets_s[i], sizeof(float));
  }

  const std::uint32_t rgba, time_offset, bytes;

 private:
  static bool HasColors(std::span<const ScanPoint> points) {
    return std::any_of(points.begin(), points.end(),
                       [](const ScanPoint& point) { return point.rgba != 0; });
  }
};

}  // namespace

void PointsToProto(std::span<const ScanPoint> points, v1::Scan* proto,
                   std::span<const float> time_offsets_s) {
  constexpr std::uint32_t kXyzBytes = 12;
  const PointStride stride(points, kXyzBytes, !time_offsets_s.empty());
  proto->clear_fields();
  for (std::uint32_t axis = 0; axis < 3; ++axis)
    AddField(kAxisNames[axis], 4 * axis, v1::PointField::TYPE_FLOAT32, proto);
  stride.AddFields(proto);
  char* to = ResizePoints(points.size(), stride.bytes, proto);
  for (std::size_t i = 0; i < points.size(); ++i, to += stride.bytes) {
    std::memcpy(to, &points[i], kXyzBytes);
    stride.WriteBehindXyz(points[i], time_offsets_s, i, to);
  }
}

absl::Status PointsToProtoInt16(std::span<const ScanPoint> points, double scale_m, v1::Scan* proto,
                                std::span<const float> time_offsets_s) {
  constexpr std::uint32_t kXyzBytes = 6;
  const PointStride stride(points, kXyzBytes, !time_offsets_s.empty());
  proto->clear_fields();
  for (std::uint32_t axis = 0; axis < 3; ++axis)
    AddField(kAxisNames[axis], 2 * axis, v1::PointField::TYPE_INT16, proto)->set_scale(scale_m);
  stride.AddFields(proto);
  char* to = ResizePoints(points.size(), stride.bytes, proto);
  const FieldPath root("points");
  for (std::size_t i = 0; i < points.size(); ++i, to += stride.bytes) {
    const std::array<float, 3> xyz = {points[i].x_m, points[i].y_m, points[i].z_m};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const double raw = std::nearbyint(static_cast<double>(xyz[axis]) / scale_m);
      if (!(std::abs(raw) <= 32767))
        return Refuse(root.At(i).Child(kAxisNames[axis]), xyz[axis],
                      absl::StrCat("at most ", 32767 * scale_m, " in magnitude"));
      const auto value = static_cast<std::int16_t>(raw);
      std::memcpy(to + 2 * axis, &value, sizeof(value));
    }
    stride.WriteBehindXyz(points[i], time_offsets_s, i, to);
  }
  return absl::OkStatus();
}

void Compress(ScanCompression compression, v1::Scan* proto) {
  if (compression == ScanCompression::kNone) return;
  if (proto->has_depth_image()) {
    v1::DepthImage* image = proto->mutable_depth_image();
    image->set_depth(Compressed(image->depth(), kZstdLevel));
    if (!image->rgb().empty()) image->set_rgb(Compressed(image->rgb(), kZstdLevel));
    proto->set_compression(v1::SCAN_COMPRESSION_ZSTD);
    return;
  }
  if (compression == ScanCompression::kDeltaZstd)
    proto->set_points(EncodeDeltas(proto->points(), proto->point_stride(), PointColumnsOf(*proto)));
  proto->set_points(Compressed(proto->points(), kZstdLevel));
  proto->set_compression(static_cast<v1::ScanCompression>(compression));
}
static_assert(static_cast<int>(ScanCompression::kZstd) == v1::SCAN_COMPRESSION_ZSTD);
static_assert(static_cast<int>(ScanCompression::kDeltaZstd) == v1::SCAN_COMPRESSION_DELTA_ZSTD);

void CovarianceToProto(const PoseCovariance& covariance, v1::Scan* proto) {
  proto->clear_pose_covariance();
  for (int i = 0; i < kCovarianceValues; ++i) proto->add_pose_covariance(0);
  for (int row = 0; row < 3; ++row)
    for (int column = row; column < 3; ++column) {
      proto->set_pose_covariance(TriangleIndex(row, column),
                                 static_cast<float>(covariance.translation_m2(row, column)));
      proto->set_pose_covariance(TriangleIndex(row + 3, column + 3),
                                 static_cast<float>(covariance.rotation_rad2(row, column)));
    }
}

}  // namespace gem::wire
