#include "proto/wire/terrain.h"

#include <cmath>

#include "absl/strings/str_cat.h"
#include "core/base/status_macros.h"
#include "core/grid/cell_index.h"
#include "gem/v1/terrain_service.pb.h"
#include "proto/wire/refusal.h"
#include "proto/wire/region.h"
#include "proto/wire/scalar.h"

namespace gem::wire {
namespace {

absl::Status CheckWithin(double value, double magnitude_max, const FieldPath& field) {
  if (std::abs(value) <= magnitude_max) return absl::OkStatus();
  return Refuse(field, value, absl::StrCat("at most ", magnitude_max, " in magnitude"));
}

absl::StatusOr<std::vector<Place>> PlacesFromProto(
    const google::protobuf::RepeatedPtrField<v1::Position>& proto, std::size_t places_max,
    const FieldPath& field) {
  if (proto.empty() || static_cast<std::size_t>(proto.size()) > places_max)
    return Refuse(field, absl::StrCat(proto.size(), " places"), absl::StrCat("1 to ", places_max));
  std::vector<Place> places;
  places.reserve(static_cast<std::size_t>(proto.size()));
  for (const v1::Position& position : proto) {
    GEM_ASSIGN_OR_RETURN(const Place place, wire::FromProto(position, field.At(places.size())));
    places.push_back(place);
  }
  return places;
}

absl::Status CheckLength(const std::vector<Place>& path, const FieldPath& field) {
  double length_m = 0;
  for (std::size_t i = 1; i < path.size(); ++i)
    length_m += std::hypot(path[i].x_m - path[i - 1].x_m, path[i].y_m - path[i - 1].y_m);
  if (length_m <= kPathLengthMax_m) return absl::OkStatus();
  return Refuse(field, absl::StrCat(length_m, " m long"),
                absl::StrCat("at most ", kPathLengthMax_m, " m"));
}

absl::StatusOr<Rectangle> FromProto(const v1::Rectangle& proto, const FieldPath& field) {
  const Rectangle r{proto.x_min(), proto.y_min(), proto.x_max(), proto.y_max()};
  GEM_RETURN_IF_ERROR(CheckWithin(r.x_m_min, kFootprintMax_m, field.Child("x_min")));
  GEM_RETURN_IF_ERROR(CheckWithin(r.y_m_min, kFootprintMax_m, field.Child("y_min")));
  GEM_RETURN_IF_ERROR(CheckWithin(r.x_m_max, kFootprintMax_m, field.Child("x_max")));
  GEM_RETURN_IF_ERROR(CheckWithin(r.y_m_max, kFootprintMax_m, field.Child("y_max")));
  if (!(r.x_m_min < r.x_m_max))
    return Refuse(field.Child("x_max"), r.x_m_max, absl::StrCat("more than x_min ", r.x_m_min));
  if (!(r.y_m_min < r.y_m_max))
    return Refuse(field.Child("y_max"), r.y_m_max, absl::StrCat("more than y_min ", r.y_m_min));
  return r;
}

absl::StatusOr<Footprint> FromProto(const v1::Footprint& proto, const FieldPath& field) {
  switch (proto.shape_case()) {
    case v1::Footprint::kRadiusM:
      if (!(proto.radius_m() >= 0 && proto.radius_m() <= kFootprintMax_m))
        return Refuse(field.Child("radius_m"), proto.radius_m(),
                      absl::StrCat("0 to ", kFootprintMax_m));
      return Disc{proto.radius_m()};
    case v1::Footprint::kRectangle:
      return FromProto(proto.rectangle(), field.Child("rectangle"));
    case v1::Footprint::SHAPE_NOT_SET:
      break;
  }
  return Refuse(field, "without a shape", "radius_m or rectangle");
}

v1::GroundSample::State ToProto(GroundState state) {
  switch (state) {
    case GroundState::kFree:
      return v1::GroundSample::STATE_FREE;
    case GroundState::kHeightOnly:
      return v1::GroundSample::STATE_HEIGHT_ONLY;
    case GroundState::kUnknown:
      break;
    case GroundState::kObstacle:
      return v1::GroundSample::STATE_OBSTACLE;
  }
  return v1::GroundSample::STATE_UNKNOWN;
}

absl::StatusOr<GroundState> FromProto(v1::GroundSample::State state, const FieldPath& field) {
  switch (state) {
    case v1::GroundSample::STATE_FREE:
      return GroundState::kFree;
    case v1::GroundSample::STATE_HEIGHT_ONLY:
      return GroundState::kHeightOnly;
    case v1::GroundSample::STATE_UNKNOWN:
      return GroundState::kUnknown;
    case v1::GroundSample::STATE_OBSTACLE:
      return GroundState::kObstacle;
    default:
      return Refuse(field, absl::StrCat(static_cast<int>(state)), "a state that is known");
  }
}

void ToProto(const GroundSample& sample, v1::GroundSample* proto) {
  proto->set_state(ToProto(sample.state));
  proto->set_elevation_m(sample.elevation_m);
  proto->set_variance_m2(sample.variance_m2);
  proto->set_traversability(sample.traversability);
  if (sample.slope_rad) proto->set_slope_rad(*sample.slope_rad);
}

absl::StatusOr<GroundSample> FromProto(const v1::GroundSample& proto, const FieldPath& field) {
  GroundSample sample;
  GEM_ASSIGN_OR_RETURN(sample.state, FromProto(proto.state(), field.Child("state")));
  GEM_RETURN_IF_ERROR(CheckFinite(proto.elevation_m(), field.Child("elevation_m")));
  GEM_RETURN_IF_ERROR(CheckFinite(proto.variance_m2(), field.Child("variance_m2")));
  GEM_RETURN_IF_ERROR(CheckFinite(proto.traversability(), field.Child("traversability")));
  GEM_RETURN_IF_ERROR(CheckFinite(proto.slope_rad(), field.Child("slope_rad")));
  sample.elevation_m = proto.elevation_m();
  sample.variance_m2 = proto.variance_m2();
  sample.traversability = proto.traversability();
  if (proto.has_slope_rad()) sample.slope_rad = proto.slope_rad();
  return sample;
}

void ToProto(const PathSample& sample, v1::PathSample* proto) {
  proto->set_distance_m(sample.distance_m);
  wire::ToProto(sample.position, proto->mutable_position());
  ToProto(sample.ground, proto->mutable_ground());
  proto->set_worst(ToProto(sample.worst));
  proto->set_traversability_min(sample.traversability_min);
  proto->set_slope_rad_max(sample.slope_rad_max);
  proto->set_unknown_share(sample.unknown_share);
}

absl::StatusOr<PathSample> FromProto(const v1::PathSample& proto, const FieldPath& field) {
  PathSample sample;
  GEM_RETURN_IF_ERROR(CheckFinite(proto.distance_m(), field.Child("distance_m")));
  sample.distance_m = proto.distance_m();
  GEM_ASSIGN_OR_RETURN(sample.position, FromProto(proto.position(), field.Child("position")));
  GEM_ASSIGN_OR_RETURN(sample.ground, FromProto(proto.ground(), field.Child("ground")));
  GEM_ASSIGN_OR_RETURN(sample.worst, FromProto(proto.worst(), field.Child("worst")));
  GEM_RETURN_IF_ERROR(CheckFinite(proto.traversability_min(), field.Child("traversability_min")));
  GEM_RETURN_IF_ERROR(CheckFinite(proto.slope_rad_max(), field.Child("slope_rad_max")));
  GEM_RETURN_IF_ERROR(CheckFinite(proto.unknown_share(), field.Child("unknown_share")));
  sample.traversability_min = proto.traversability_min();
  sample.slope_rad_max = proto.slope_rad_max();
  sample.unknown_share = proto.unknown_share();
  return sample;
}

}  // namespace

absl::StatusOr<std::vector<Place>> PointsFromProto(const v1::SampleHeightsRequest& proto) {
  return PlacesFromProto(proto.points(), kGroundPoints_max, FieldPath("points"));
}

void ToProto(const std::vector<Place>& points, v1::SampleHeightsRequest* proto) {
  for (const Place& point : points) ToProto(point, proto->add_points());
}

void ToProto(const std::vector<GroundSample>& samples, v1::SampleHeightsResponse* proto) {
  proto->mutable_samples()->Reserve(static_cast<int>(samples.size()));
  for (const GroundSample& sample : samples) ToProto(sample, proto->add_samples());
}

absl::StatusOr<std::vector<GroundSample>> FromProto(const v1::SampleHeightsResponse& proto,
                                                    std::size_t num_points) {
  const FieldPath field("samples");
  if (static_cast<std::size_t>(proto.samples_size()) != num_points)
    return Refuse(field, absl::StrCat(proto.samples_size(), " samples"),
                  absl::StrCat(num_points, ", one for each point"));
  std::vector<GroundSample> samples;
  samples.reserve(num_points);
  for (const v1::GroundSample& sample : proto.samples()) {
    GEM_ASSIGN_OR_RETURN(const GroundSample ground, FromProto(sample, field.At(samples.size())));
    samples.push_back(ground);
  }
  return samples;
}

absl::StatusOr<PathQuestion> FromProto(const v1::CheckPathRequest& proto) {
  const FieldPath path("path");
  PathQuestion question;
  GEM_ASSIGN_OR_RETURN(question.path, PlacesFromProto(proto.path(), kPathCorners_max, path));
  GEM_RETURN_IF_ERROR(CheckLength(question.path, path));
  GEM_ASSIGN_OR_RETURN(question.footprint, FromProto(proto.footprint(), FieldPath("footprint")));
  if (!(proto.step_m() >= 0) || std::isinf(proto.step_m()))
    return Refuse(FieldPath("step_m"), proto.step_m(), "0, or a positive length");
  question.step_m = proto.step_m();
  return question;
}

void ToProto(const PathQuestion& question, v1::CheckPathRequest* proto) {
  for (const Place& corner : question.path) ToProto(corner, proto->add_path());
  if (const auto* disc = std::get_if<Disc>(&question.footprint)) {
    proto->mutable_footprint()->set_radius_m(disc->radius_m);
  } else {
    const Rectangle& rectangle = std::get<Rectangle>(question.footprint);
    v1::Rectangle* to = proto->mutable_footprint()->mutable_rectangle();
    to->set_x_min(rectangle.x_m_min);
    to->set_y_min(rectangle.y_m_min);
    to->set_x_max(rectangle.x_m_max);
    to->set_y_max(rectangle.y_m_max);
  }
  proto->set_step_m(question.step_m);
}

void ToProto(const PathCheck& check, v1::CheckPathResponse* proto) {
  proto->mutable_samples()->Reserve(static_cast<int>(check.samples.size()));
  for (const PathSample& sample : check.samples) ToProto(sample, proto->add_samples());
  proto->set_free(check.free);
  ToProto(check.worst.position, proto->mutable_worst()->mutable_position());
  ToProto(check.worst.ground, proto->mutable_worst()->mutable_ground());
  proto->mutable_worst()->set_sample(static_cast<std::uint32_t>(check.worst.sample));
  proto->set_free_distance_m(check.free_distance_m);
}

absl::StatusOr<PathCheck> FromProto(const v1::CheckPathResponse& proto) {
  const FieldPath samples("samples");
  const auto num_samples = static_cast<std::size_t>(proto.samples_size());
  if (num_samples < 1 || num_samples > kPathSamples_max)
    return Refuse(samples, absl::StrCat(num_samples, " samples"),
                  absl::StrCat("1 to ", kPathSamples_max));
  PathCheck check;
  check.samples.reserve(num_samples);
  for (const v1::PathSample& sample : proto.samples()) {
    GEM_ASSIGN_OR_RETURN(const PathSample path_sample,
                         FromProto(sample, samples.At(check.samples.size())));
    check.samples.push_back(path_sample);
  }
  // A footprint reaches beyond the coordinates that a path may have.
  const FieldPath worst("worst");
  GEM_ASSIGN_OR_RETURN(
      check.worst.position,
      FromProto(proto.worst().position(), worst.Child("position"), 2 * kCoordinateMax_m));
  GEM_ASSIGN_OR_RETURN(check.worst.ground,
                       FromProto(proto.worst().ground(), worst.Child("ground")));
  if (proto.worst().sample() >= num_samples)
    return Refuse(worst.Child("sample"), absl::StrCat(proto.worst().sample()),
                  absl::StrCat("less than ", num_samples));
  check.worst.sample = proto.worst().sample();
  GEM_RETURN_IF_ERROR(CheckFinite(proto.free_distance_m(), FieldPath("free_distance_m")));
  check.free = proto.free();
  check.free_distance_m = proto.free_distance_m();
  return check;
}

}  // namespace gem::wire
