#include "proto/wire/session_setup.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/str_cat.h"
#include "core/base/status_macros.h"
#include "gem/v1/ingest_service.pb.h"
#include "proto/wire/pose.h"
#include "proto/wire/refusal.h"
#include "proto/wire/scalar.h"

namespace gem::wire {
namespace {

/// On the wire zero means the default.
float OrDefault(float value, float standard) { return value == 0 ? standard : value; }
float NotZero(float value) { return value == 0 ? 1e-9f : value; }

absl::StatusOr<NoiseModel> NoiseFromProto(const v1::SensorSetup& proto) {
  switch (proto.noise_case()) {
    case v1::SensorSetup::kStereo: {
      const StereoNoise standard;
      return MakeNoiseModel(StereoNoise{
          .focal_length_px = proto.stereo().focal_length_px(),
          .baseline_m = proto.stereo().baseline_m(),
          .sigma_disparity_px =
              OrDefault(proto.stereo().sigma_disparity_px(), standard.sigma_disparity_px),
          .sigma_pixel_px = OrDefault(proto.stereo().sigma_pixel_px(), standard.sigma_pixel_px)});
    }
    case v1::SensorSetup::kDepthCamera: {
      const DepthCameraNoise standard;
      return MakeNoiseModel(DepthCameraNoise{
          .a_m = OrDefault(proto.depth_camera().a_m(), standard.a_m),
          .b_per_m = OrDefault(proto.depth_camera().b_per_m(), standard.b_per_m),
          .c_m = OrDefault(proto.depth_camera().c_m(), standard.c_m),
          .lateral_per_m =
              OrDefault(proto.depth_camera().lateral_per_m(), standard.lateral_per_m)});
    }
    case v1::SensorSetup::kLidar:
    case v1::SensorSetup::NOISE_NOT_SET:
      break;
  }
  const LidarNoise standard;
  return MakeNoiseModel(LidarNoise{
      .sigma_axial_m = OrDefault(proto.lidar().sigma_axial_m(), standard.sigma_axial_m),
      .sigma_lateral_m = OrDefault(proto.lidar().sigma_lateral_m(), standard.sigma_lateral_m),
      .sigma_lateral_per_m =
          OrDefault(proto.lidar().sigma_lateral_per_m(), standard.sigma_lateral_per_m)});
}

/// The text of core says "lidar.sigma_axial_m is -1, ...": the path goes before it.
absl::Status UnderField(const absl::Status& status, const FieldPath& field) {
  const std::string text(status.message());
  const std::string prefix = field.ToString();
  const std::string name = text.substr(0, text.find(' '));
  return WithField(absl::InvalidArgumentError(absl::StrCat(prefix, ".", text)),
                   absl::StrCat(prefix, ".", name));
}

absl::StatusOr<BodyBox> BodyFromProto(const v1::Box& proto, const FieldPath& field) {
  struct Axis {
    const char* name_min;
    const char* name_max;
    float min, max;
  };
  const Axis axes[] = {{"x_min", "x_max", proto.x_min(), proto.x_max()},
                       {"y_min", "y_max", proto.y_min(), proto.y_max()},
                       {"z_min", "z_max", proto.z_min(), proto.z_max()}};
  for (const Axis& axis : axes) {
    GEM_RETURN_IF_ERROR(CheckFinite(axis.min, field.Child(axis.name_min)));
    GEM_RETURN_IF_ERROR(CheckFinite(axis.max, field.Child(axis.name_max)));
    if (axis.min > axis.max)
      return Refuse(field.Child(axis.name_min), axis.min,
                    absl::StrCat("at most ", axis.name_max, " = ", axis.max));
  }
  return BodyBox{proto.x_min(), proto.y_min(), proto.z_min(),
                 proto.x_max(), proto.y_max(), proto.z_max()};
}

absl::StatusOr<LocalMapSetup> LocalMapFromProto(const v1::LocalMapSetup& proto,
                                                const FieldPath& field) {
  LocalMapSetup setup;
  GEM_RETURN_IF_ERROR(CheckFinite(proto.side_m(), field.Child("side_m")));
  GEM_RETURN_IF_ERROR(CheckFinite(proto.range_m_min(), field.Child("range_m_min")));
  GEM_RETURN_IF_ERROR(CheckFinite(proto.range_m_max(), field.Child("range_m_max")));
  GEM_RETURN_IF_ERROR(CheckFinite(proto.height_m_min(), field.Child("height_m_min")));
  GEM_RETURN_IF_ERROR(CheckFinite(proto.height_m_max(), field.Child("height_m_max")));
  if (proto.side_m() != 0) setup.side_m = proto.side_m();
  if (proto.has_range_m_min()) setup.range_m_min = proto.range_m_min();
  if (proto.has_range_m_max()) setup.range_m_max = proto.range_m_max();
  if (proto.has_height_m_min()) setup.height_m_min = proto.height_m_min();
  if (proto.has_height_m_max()) setup.height_m_max = proto.height_m_max();
  if (proto.has_body()) {
    GEM_ASSIGN_OR_RETURN(setup.body, BodyFromProto(proto.body(), field.Child("body")));
  }
  return setup;
}

absl::Status Conflict(const char* field, absl::string_view wanted, absl::string_view has) {
  const std::string path = absl::StrCat("open.map_setup.", field);
  return WithField(absl::FailedPreconditionError(
                       absl::StrCat(path, " is ", wanted, ", want ", has, " as the map has")),
                   path);
}

}  // namespace

LocalMapOptions LocalMapSetup::Over(LocalMapOptions options) const {
  options.side_m = side_m.value_or(options.side_m);
  options.range_m_min = range_m_min.value_or(options.range_m_min);
  options.range_m_max = range_m_max.value_or(options.range_m_max);
  options.height_m_min = height_m_min.value_or(options.height_m_min);
  options.height_m_max = height_m_max.value_or(options.height_m_max);
  options.body = body.value_or(options.body);
  return options;
}

GlobalMapOptions MapSetup::Over(GlobalMapOptions options) const {
  options.cell_size_m = cell_size_m.value_or(options.cell_size_m);
  options.submap_length_m = submap_length_m.value_or(options.submap_length_m);
  options.traversable_only = traversable_only || options.traversable_only;
  return options;
}

absl::Status MapSetup::CheckAgainst(const GlobalMapOptions& map) const {
  if (cell_size_m.has_value() && *cell_size_m != map.cell_size_m)
    return Conflict("cell_size_m", absl::StrCat(*cell_size_m), absl::StrCat(map.cell_size_m));
  if (submap_length_m.has_value() && *submap_length_m != map.submap_length_m)
    return Conflict("submap_length_m", absl::StrCat(*submap_length_m),
                    absl::StrCat(map.submap_length_m));
  if (traversable_only && !map.traversable_only)
    return Conflict("traversable_only", "true", "false");
  return absl::OkStatus();
}

absl::StatusOr<MapSetup> FromProto(const v1::MapSetup& proto, const FieldPath& field) {
  GEM_RETURN_IF_ERROR(CheckFinite(proto.cell_size_m(), field.Child("cell_size_m")));
  GEM_RETURN_IF_ERROR(CheckFinite(proto.submap_length_m(), field.Child("submap_length_m")));
  MapSetup setup;
  if (proto.cell_size_m() != 0) setup.cell_size_m = proto.cell_size_m();
  if (proto.submap_length_m() != 0) setup.submap_length_m = proto.submap_length_m();
  setup.traversable_only = proto.traversable_only();
  return setup;
}

absl::StatusOr<SensorSetup> FromProto(const v1::SensorSetup& proto, const FieldPath& field) {
  GEM_RETURN_IF_ERROR(CheckId(proto.name(), field.Child("name")));
  if (!proto.has_base_from_sensor())
    return Refuse(field.Child("base_from_sensor"), "unset", "a transform");
  auto T_B_S = FromProto<Base, Sensor>(proto.base_from_sensor(), field.Child("base_from_sensor"));
  if (!T_B_S.ok()) return T_B_S.status();
  const absl::StatusOr<NoiseModel> noise = NoiseFromProto(proto);
  if (!noise.ok()) return UnderField(noise.status(), field);
  return SensorSetup{proto.name(), *T_B_S, *noise};
}

absl::StatusOr<SessionSetup> FromProto(const v1::OpenSession& proto, const FieldPath& field) {
  GEM_RETURN_IF_ERROR(CheckId(proto.map(), field.Child("map")));
  GEM_RETURN_IF_ERROR(CheckId(proto.robot(), field.Child("robot")));
  GEM_RETURN_IF_ERROR(CheckId(proto.session(), field.Child("session")));
  SessionSetup setup{proto.map(), proto.robot(), proto.session(), {}, {}, {}, {}};
  if (proto.has_map_from_odom()) {
    auto T_G_O = FromProto<Global, Odom>(proto.map_from_odom(), field.Child("map_from_odom"));
    if (!T_G_O.ok()) return T_G_O.status();
    setup.T_G_O = *T_G_O;
  }
  const FieldPath sensors = field.Child("sensors");
  if (proto.sensors_size() < 1 || proto.sensors_size() > kSensors_max)
    return Refuse(sensors, absl::StrCat(proto.sensors_size(), " sensors"),
                  absl::StrCat("1 to ", kSensors_max));
  for (int i = 0; i < proto.sensors_size(); ++i) {
    const FieldPath element = sensors.At(static_cast<std::size_t>(i));
    absl::StatusOr<SensorSetup> sensor = FromProto(proto.sensors(i), element);
    if (!sensor.ok()) return sensor.status();
    const bool repeated = std::any_of(setup.sensors.begin(), setup.sensors.end(),
                                      [&](const SensorSetup& s) { return s.name == sensor->name; });
    if (repeated)
      return Refuse(element.Child("name"),
                    absl::StrCat("\"", sensor->name, "\" for the second time"), "each name once");
    setup.sensors.push_back(*std::move(sensor));
  }
  GEM_ASSIGN_OR_RETURN(setup.local_map,
                       LocalMapFromProto(proto.local_map(), field.Child("local_map")));
  GEM_ASSIGN_OR_RETURN(setup.map_setup, FromProto(proto.map_setup(), field.Child("map_setup")));
  return setup;
}

void ToProto(const SensorSetup& sensor, v1::SensorSetup* proto) {
  proto->set_name(sensor.name);
  ToProto(sensor.T_B_S, proto->mutable_base_from_sensor());
  const NoiseModel& noise = sensor.noise;
  if (noise.along_beam) {
    v1::LidarNoise* lidar = proto->mutable_lidar();
    lidar->set_sigma_axial_m(NotZero(noise.axial_m[0]));
    lidar->set_sigma_lateral_m(NotZero(noise.lateral_m[0]));
    lidar->set_sigma_lateral_per_m(NotZero(noise.lateral_m[1]));
  } else if (noise.axial_m[0] == 0 && noise.axial_m[1] == 0) {
    // sigma_z = z^2 * per_m: a stereo camera of focal length 1 and baseline 1.
    v1::StereoNoise* stereo = proto->mutable_stereo();
    stereo->set_focal_length_px(1);
    stereo->set_baseline_m(1);
    stereo->set_sigma_disparity_px(NotZero(noise.axial_m[2]));
    stereo->set_sigma_pixel_px(NotZero(noise.lateral_m[1]));
  } else {
    // a + b (z - c)^2 = (a + b c^2) - 2 b c z + b z^2.
    const float b = noise.axial_m[2];
    const float c = b > 0 ? -noise.axial_m[1] / (2 * b) : 0;
    v1::DepthCameraNoise* depth = proto->mutable_depth_camera();
    depth->set_a_m(NotZero(noise.axial_m[0] - b * c * c));
    depth->set_b_per_m(NotZero(b));
    depth->set_c_m(NotZero(c));
    depth->set_lateral_per_m(NotZero(noise.lateral_m[1]));
  }
}

void ToProto(const MapSetup& setup, v1::MapSetup* proto) {
  proto->set_cell_size_m(setup.cell_size_m.value_or(0));
  proto->set_submap_length_m(setup.submap_length_m.value_or(0));
  proto->set_traversable_only(setup.traversable_only);
}

void ToProto(const SessionSetup& setup, v1::OpenSession* proto) {
  proto->set_map(setup.map);
  proto->set_robot(setup.robot);
  proto->set_session(setup.session);
  ToProto(setup.T_G_O, proto->mutable_map_from_odom());
  proto->clear_sensors();
  for (const SensorSetup& sensor : setup.sensors) ToProto(sensor, proto->add_sensors());
  v1::LocalMapSetup* local_map = proto->mutable_local_map();
  const LocalMapSetup& local = setup.local_map;
  local_map->set_side_m(local.side_m.value_or(0));
  if (local.range_m_min) local_map->set_range_m_min(*local.range_m_min);
  if (local.range_m_max) local_map->set_range_m_max(*local.range_m_max);
  if (local.height_m_min) local_map->set_height_m_min(*local.height_m_min);
  if (local.height_m_max) local_map->set_height_m_max(*local.height_m_max);
  if (local.body) {
    v1::Box* body = local_map->mutable_body();
    body->set_x_min(local.body->x_m_min);
    body->set_y_min(local.body->y_m_min);
    body->set_z_min(local.body->z_m_min);
    body->set_x_max(local.body->x_m_max);
    body->set_y_max(local.body->y_m_max);
    body->set_z_max(local.body->z_m_max);
  }
  ToProto(setup.map_setup, proto->mutable_map_setup());
}

}  // namespace gem::wire
