#include "proto/wire/scan.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <span>
#include <utility>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "core/base/status_macros.h"
#include "core/grid/cell_index.h"
#include "core/sensor/deskew.h"
#include "gem/v1/types.pb.h"
#include "proto/wire/depth_image.h"
#include "proto/wire/pose.h"
#include "proto/wire/refusal.h"
#include "proto/wire/scalar.h"
#include "proto/wire/scan_codec.h"
#include "proto/wire/zstd_frame.h"

namespace gem::wire {
namespace {

static_assert(std::endian::native == std::endian::little, "points are copied as they lie");

constexpr std::uint32_t kStrideMin = 6;
constexpr std::uint32_t kStrideMax = 256;
constexpr int kFieldsMin = 3;
constexpr int kFieldsMax = 16;
constexpr int kCovarianceValues = 21;
constexpr float kCovarianceMax = 1e6f;
constexpr double kScaleMax_m = 1e3;
/// Higher levels take 3 % less for twice the time.
constexpr int kZstdLevel = 1;

/// Where one value lies within a point.
struct Column {
  bool present = false;
  v1::PointField::Type type = v1::PointField::TYPE_UNSPECIFIED;
  std::uint32_t offset = 0;
  float scale = 1;
};

struct Layout {
  std::uint32_t stride = 0;
  std::array<Column, 3> xyz;
  Column rgba;
  Column time_offset;
};

constexpr std::array<const char*, 3> kAxisNames = {"x", "y", "z"};
constexpr char kColorName[] = "rgba";
constexpr char kTimeOffsetName[] = "time_offset";
constexpr char kTimeOffsetShortName[] = "t";

std::uint32_t WidthOf(v1::PointField::Type type) {
  switch (type) {
    case v1::PointField::TYPE_UINT8:
      return 1;
    case v1::PointField::TYPE_UINT16:
    case v1::PointField::TYPE_INT16:
      return 2;
    case v1::PointField::TYPE_UINT32:
    case v1::PointField::TYPE_FLOAT32:
      return 4;
    default:
      return 0;
  }
}

std::string TypeName(v1::PointField::Type type) {
  const std::string& name = v1::PointField::Type_Name(type);
  return name.empty() ? absl::StrCat(static_cast<int>(type)) : name;
}

absl::Status CheckScale(const v1::PointField& proto, const FieldPath& field) {
  const double scale = proto.scale();
  if (proto.type() == v1::PointField::TYPE_INT16) {
    if (scale == 0 || (std::isfinite(scale) && scale > 0 && scale <= kScaleMax_m))
      return absl::OkStatus();
    return Refuse(field, scale, absl::StrCat("0 (means 1) to ", kScaleMax_m));
  }
  if (scale == 0) return absl::OkStatus();
  return Refuse(field, scale, absl::StrCat("0 for ", TypeName(proto.type())));
}

/// Null for a name that means nothing to us.
Column* ColumnNamed(const std::string& name, Layout& layout) {
  for (std::size_t axis = 0; axis < kAxisNames.size(); ++axis)
    if (name == kAxisNames[axis]) return &layout.xyz[axis];
  if (name == kColorName) return &layout.rgba;
  if (name == kTimeOffsetName || name == kTimeOffsetShortName) return &layout.time_offset;
  return nullptr;
}

/// The types that the column may have: one or two.
std::pair<v1::PointField::Type, v1::PointField::Type> TypesOf(const Column& column,
                                                              const Layout& layout) {
  if (&column == &layout.rgba) return {v1::PointField::TYPE_UINT32, v1::PointField::TYPE_UINT32};
  if (&column == &layout.time_offset)
    return {v1::PointField::TYPE_FLOAT32, v1::PointField::TYPE_UINT32};
  return {v1::PointField::TYPE_FLOAT32, v1::PointField::TYPE_INT16};
}

absl::Status AddColumn(const v1::PointField& proto, const FieldPath& field, Layout& layout) {
  const std::uint32_t width = WidthOf(proto.type());
  if (width == 0) return Refuse(field.Child("type"), TypeName(proto.type()), "a known type");
  // In 64 bits: an offset near 2^32 must not wrap round to a small sum.
  if (std::uint64_t{proto.offset()} + width > layout.stride)
    return Refuse(field.Child("offset"), absl::StrCat(proto.offset()),
                  absl::StrCat("at most point_stride - width = ", layout.stride, " - ", width));
  GEM_RETURN_IF_ERROR(CheckScale(proto, field.Child("scale")));

  Column* column = ColumnNamed(proto.name(), layout);
  if (column == nullptr) return absl::OkStatus();
  if (column->present)
    return Refuse(field.Child("name"), absl::StrCat("\"", proto.name(), "\" for the second time"),
                  "each name once");
  const auto [a, b] = TypesOf(*column, layout);
  if (proto.type() != a && proto.type() != b)
    return Refuse(field.Child("type"), TypeName(proto.type()),
                  absl::StrCat(TypeName(a), a == b ? "" : absl::StrCat(" or ", TypeName(b)),
                               " for ", proto.name()));
  const float scale = proto.scale() == 0 ? 1.0f : static_cast<float>(proto.scale());
  *column = {.present = true, .type = proto.type(), .offset = proto.offset(), .scale = scale};
  return absl::OkStatus();
}

absl::StatusOr<Layout> LayoutFromProto(const v1::Scan& proto, const FieldPath& field) {
  Layout layout{.stride = proto.point_stride(), .xyz = {}, .rgba = {}, .time_offset = {}};
  if (layout.stride < kStrideMin || layout.stride > kStrideMax)
    return Refuse(field.Child("point_stride"), absl::StrCat(layout.stride),
                  absl::StrCat(kStrideMin, " to ", kStrideMax));
  const FieldPath fields = field.Child("fields");
  if (proto.fields_size() < kFieldsMin || proto.fields_size() > kFieldsMax)
    return Refuse(fields, absl::StrCat(proto.fields_size(), " fields"),
                  absl::StrCat(kFieldsMin, " to ", kFieldsMax));
  for (int i = 0; i < proto.fields_size(); ++i)
    GEM_RETURN_IF_ERROR(AddColumn(proto.fields(i), fields.At(static_cast<std::size_t>(i)), layout));
  for (std::size_t axis = 0; axis < kAxisNames.size(); ++axis)
    if (!layout.xyz[axis].present)
      return Refuse(fields, absl::StrCat("without \"", kAxisNames[axis], "\""),
                    "x, y and z once each");
  return layout;
}

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

/// Of a layout that fits the stride.
std::vector<PointColumn> ColumnsOf(const v1::Scan& proto) {
  std::vector<PointColumn> fields;
  for (const v1::PointField& field : proto.fields())
    fields.push_back({field.offset(), WidthOf(field.type())});
  return ColumnsOf(fields, proto.point_stride());
}

/// The points as the driver packed them: those of `proto`, or inflated into `buffer`. The layout
/// was checked.
absl::StatusOr<absl::string_view> PackedPoints(const v1::Scan& proto, ScanCompression compression,
                                               const ScanLimits& limits, const FieldPath& field,
                                               std::string& buffer) {
  GEM_RETURN_IF_ERROR(CheckSize(proto, compression != ScanCompression::kNone, limits, field));
  if (compression == ScanCompression::kNone) return absl::string_view(proto.points());
  const std::size_t bytes = std::size_t{proto.point_count()} * proto.point_stride();
  GEM_ASSIGN_OR_RETURN(buffer, Inflated(proto.points(), bytes, field.Child("points")));
  if (compression == ScanCompression::kDeltaZstd)
    buffer = DecodeDeltas(buffer, proto.point_stride(), ColumnsOf(proto));
  return absl::string_view(buffer);
}

template <typename T>
T Load(const char* at) {
  T value;
  std::memcpy(&value, at, sizeof(T));
  return value;
}

float LoadAxis(const char* point, const Column& column) {
  if (column.type == v1::PointField::TYPE_INT16)
    return static_cast<float>(Load<std::int16_t>(point + column.offset)) * column.scale;
  return Load<float>(point + column.offset);
}

bool InRange(float value_m) { return std::abs(value_m) <= static_cast<float>(kCoordinateMax_m); }

absl::Status RefusePoint(const ScanPoint& point, std::size_t index, const FieldPath& field) {
  const FieldPath points = field.Child("points");
  const FieldPath element = points.At(index);
  const std::array<float, 3> xyz = {point.x_m, point.y_m, point.z_m};
  for (std::size_t axis = 0; axis < xyz.size(); ++axis) {
    if (!std::isfinite(xyz[axis]))
      return Refuse(element.Child(kAxisNames[axis]), xyz[axis], "a finite number");
    if (!InRange(xyz[axis]))
      return Refuse(element.Child(kAxisNames[axis]), xyz[axis],
                    absl::StrCat("at most ", kCoordinateMax_m, " in magnitude"));
  }
  return absl::InternalError("a point that is in range was refused");
}

/// Seconds; a UINT32 holds nanoseconds.
float LoadTimeOffset_s(const char* point, const Column& column) {
  if (column.type == v1::PointField::TYPE_UINT32)
    return static_cast<float>(Load<std::uint32_t>(point + column.offset) * 1e-9);
  return Load<float>(point + column.offset);
}

absl::Status DecodeTimeOffsets(absl::string_view packed, const Layout& layout,
                               const FieldPath& field, std::vector<float>& time_offsets_s) {
  time_offsets_s.resize(layout.time_offset.present ? packed.size() / layout.stride : 0);
  const char* at = packed.data();
  for (std::size_t i = 0; i < time_offsets_s.size(); ++i, at += layout.stride) {
    time_offsets_s[i] = LoadTimeOffset_s(at, layout.time_offset);
    if (!(std::abs(time_offsets_s[i]) <= kTimeOffsetMax_s)) [[unlikely]] {  // NaN, too
      const FieldPath points = field.Child("points");
      const FieldPath point = points.At(i);
      return Refuse(point.Child(kTimeOffsetName), time_offsets_s[i],
                    absl::StrCat("at most ", kTimeOffsetMax_s, " s in magnitude"));
    }
  }
  return absl::OkStatus();
}

/// Grows with the magnitude; NaN exceeds infinity.
std::int32_t MagnitudeBits(float value) {
  return std::bit_cast<std::int32_t>(value) & std::numeric_limits<std::int32_t>::max();
}

/// x, y and z, all stored as Axis, and no colour. Without a branch, which doubles the speed of
/// INT16. False if a point is out of range.
template <typename Axis>
bool DecodeAxes(const char* at, const Layout& layout, std::span<ScanPoint> points) {
  const std::int32_t most = MagnitudeBits(static_cast<float>(kCoordinateMax_m));
  const auto& [x, y, z] = layout.xyz;
  std::int32_t beyond = 0;  // negative once one is
  for (ScanPoint& point : points) {
    point = {static_cast<float>(Load<Axis>(at + x.offset)) * x.scale,
             static_cast<float>(Load<Axis>(at + y.offset)) * y.scale,
             static_cast<float>(Load<Axis>(at + z.offset)) * z.scale, 0};
    beyond |= (most - MagnitudeBits(point.x_m)) | (most - MagnitudeBits(point.y_m)) |
              (most - MagnitudeBits(point.z_m));
    at += layout.stride;
  }
  return beyond >= 0;
}

void DecodeMixedAxes(const char* at, const Layout& layout, std::span<ScanPoint> points) {
  const auto& [x, y, z] = layout.xyz;
  for (ScanPoint& point : points) {
    point = {LoadAxis(at, x), LoadAxis(at, y), LoadAxis(at, z), 0};
    at += layout.stride;
  }
}

void DecodeColors(const char* at, const Layout& layout, std::span<ScanPoint> points) {
  for (ScanPoint& point : points) {
    const Rgba rgba = Load<Rgba>(at + layout.rgba.offset);
    // Inside the mapper a colour is there (alpha 255) or not (0): half transparent means there.
    point.rgba = (rgba >> 24) == 0 ? 0 : rgba | 0xff000000u;
    at += layout.stride;
  }
}

absl::Status DecodePoints(absl::string_view packed, const Layout& layout, const FieldPath& field,
                          std::vector<ScanPoint>& points) {
  points.resize(packed.size() / layout.stride);
  const char* at = packed.data();
  const auto are = [&](v1::PointField::Type type) {
    return std::all_of(layout.xyz.begin(), layout.xyz.end(),
                       [&](const Column& column) { return column.type == type; });
  };
  bool in_range = false;  // or not known to be
  if (are(v1::PointField::TYPE_FLOAT32)) {
    in_range = DecodeAxes<float>(at, layout, points);
  } else if (are(v1::PointField::TYPE_INT16)) {
    in_range = DecodeAxes<std::int16_t>(at, layout, points);
  } else {
    DecodeMixedAxes(at, layout, points);
  }
  for (std::size_t i = 0; i < points.size() && !in_range; ++i) {
    const ScanPoint& point = points[i];
    if (!(InRange(point.x_m) && InRange(point.y_m) && InRange(point.z_m)))
      return RefusePoint(point, i, field);
  }
  if (layout.rgba.present) DecodeColors(at, layout, points);
  return absl::OkStatus();
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
                              const FieldPath& field, DecodedScan& scan) {
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
  GEM_ASSIGN_OR_RETURN(const Layout layout, LayoutFromProto(proto, field));
  std::string buffer;
  GEM_ASSIGN_OR_RETURN(const absl::string_view packed,
                       PackedPoints(proto, compression, limits, field, buffer));
  GEM_RETURN_IF_ERROR(DecodePoints(packed, layout, field, scan.points));
  return DecodeTimeOffsets(packed, layout, field, scan.time_offsets_s);
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
                       DecodedScan& scan) {
  scan.seq = proto.seq();
  scan.stamp_ns = proto.stamp_ns();
  scan.T_O_B.reset();
  scan.covariance.reset();
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
  return PayloadFromProto(proto, limits, field, scan);
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
    proto->set_points(EncodeDeltas(proto->points(), proto->point_stride(), ColumnsOf(*proto)));
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
