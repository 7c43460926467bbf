#include "proto/wire/point_layout.h"

#include <cmath>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "core/base/status_macros.h"
#include "gem/v1/types.pb.h"
#include "proto/wire/refusal.h"

namespace gem::wire {
namespace {

constexpr std::uint32_t kStrideMin = 6;
constexpr std::uint32_t kStrideMax = 256;
constexpr int kFieldsMin = 3;
constexpr int kFieldsMax = 16;
constexpr double kScaleMax_m = 1e3;
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

/// Of a type that AddColumn has let pass.
ValueType ValueTypeOf(v1::PointField::Type type) {
  switch (type) {
    case v1::PointField::TYPE_INT16:
      return ValueType::kInt16;
    case v1::PointField::TYPE_UINT32:
      return ValueType::kUint32;
    default:
      return ValueType::kFloat32;
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
Column* ColumnNamed(const std::string& name, PointLayout& layout) {
  for (std::size_t axis = 0; axis < kAxisNames.size(); ++axis)
    if (name == kAxisNames[axis]) return &layout.xyz[axis];
  if (name == kColorName) return &layout.rgba;
  if (name == kTimeOffsetName || name == kTimeOffsetShortName) return &layout.time_offset;
  return nullptr;
}

/// The types that the column may have: one or two.
std::pair<v1::PointField::Type, v1::PointField::Type> TypesOf(const Column& column,
                                                              const PointLayout& layout) {
  if (&column == &layout.rgba) return {v1::PointField::TYPE_UINT32, v1::PointField::TYPE_UINT32};
  if (&column == &layout.time_offset)
    return {v1::PointField::TYPE_FLOAT32, v1::PointField::TYPE_UINT32};
  return {v1::PointField::TYPE_FLOAT32, v1::PointField::TYPE_INT16};
}

absl::Status AddColumn(const v1::PointField& proto, const FieldPath& field, PointLayout& layout) {
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
  *column = {
      .present = true, .type = ValueTypeOf(proto.type()), .offset = proto.offset(), .scale = scale};
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<PointLayout> LayoutFromProto(const v1::Scan& proto, const FieldPath& field) {
  PointLayout layout{.stride = proto.point_stride(), .xyz = {}, .rgba = {}, .time_offset = {}};
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

std::vector<PointColumn> PointColumnsOf(const v1::Scan& proto) {
  std::vector<PointColumn> fields;
  for (const v1::PointField& field : proto.fields())
    fields.push_back({field.offset(), WidthOf(field.type())});
  return ColumnsOf(fields, proto.point_stride());
}

}  // namespace gem::wire
