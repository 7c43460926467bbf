#include "proto/wire/region.h"

#include <cmath>

#include "absl/strings/str_cat.h"
#include "core/base/status_macros.h"
#include "gem/v1/types.pb.h"
#include "proto/wire/refusal.h"

namespace gem::wire {
namespace {

/// NaN is not within anything.
absl::Status CheckWithin(double value, double magnitude_max, const FieldPath& field) {
  if (std::abs(value) <= magnitude_max) return absl::OkStatus();
  return Refuse(field, value, absl::StrCat("at most ", magnitude_max, " in magnitude"));
}

}  // namespace

absl::StatusOr<Place> FromProto(const v1::Position& proto, const FieldPath& field,
                                double magnitude_m_max) {
  GEM_RETURN_IF_ERROR(CheckWithin(proto.x(), magnitude_m_max, field.Child("x")));
  GEM_RETURN_IF_ERROR(CheckWithin(proto.y(), magnitude_m_max, field.Child("y")));
  return Place{proto.x(), proto.y()};
}

void ToProto(const Place& place, v1::Position* proto) {
  proto->set_x(place.x_m);
  proto->set_y(place.y_m);
}

absl::StatusOr<Region> FromProto(const v1::Region& proto, const FieldPath& field) {
  GEM_RETURN_IF_ERROR(CheckWithin(proto.x_min(), kCoordinateMax_m, field.Child("x_min")));
  GEM_RETURN_IF_ERROR(CheckWithin(proto.y_min(), kCoordinateMax_m, field.Child("y_min")));
  GEM_RETURN_IF_ERROR(CheckWithin(proto.x_max(), kCoordinateMax_m, field.Child("x_max")));
  GEM_RETURN_IF_ERROR(CheckWithin(proto.y_max(), kCoordinateMax_m, field.Child("y_max")));
  if (!(proto.x_max() > proto.x_min()))
    return Refuse(field.Child("x_max"), proto.x_max(), absl::StrCat("more than ", proto.x_min()));
  if (!(proto.y_max() > proto.y_min()))
    return Refuse(field.Child("y_max"), proto.y_max(), absl::StrCat("more than ", proto.y_min()));
  return Region{proto.x_min(), proto.y_min(), proto.x_max(), proto.y_max()};
}

void ToProto(const Region& region, v1::Region* proto) {
  proto->set_x_min(region.x_m_min);
  proto->set_y_min(region.y_m_min);
  proto->set_x_max(region.x_m_max);
  proto->set_y_max(region.y_m_max);
}

}  // namespace gem::wire
