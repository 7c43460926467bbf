// gem.v1.OpenSession <-> what a session is made of: ids, sensors, overrides of the server's
// defaults.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "core/geometry/pose.h"
#include "core/global/global_map_options.h"
#include "core/local/local_map_options.h"
#include "core/sensor/noise_model.h"
#include "proto/wire/field_path.h"

namespace gem::v1 {
class LocalMapSetup;
class MapSetup;
class OpenSession;
class SensorSetup;
}  // namespace gem::v1

namespace gem::wire {

struct SensorSetup {
  std::string name;
  Pose<Base, Sensor> T_B_S;
  NoiseModel noise;
};

/// What is unset takes the server's default.
struct LocalMapSetup {
  std::optional<float> side_m;
  std::optional<float> range_m_min;
  std::optional<float> range_m_max;
  std::optional<float> height_m_min;
  std::optional<float> height_m_max;
  std::optional<BodyBox> body;

  /// `options` with what is set here. Not yet validated as a whole.
  LocalMapOptions Over(LocalMapOptions options) const;
};

/// What is unset takes the server's default, or what the map has.
struct MapSetup {
  std::optional<float> cell_size_m;
  std::optional<float> submap_length_m;
  bool traversable_only = false;  ///< false: unset

  /// `options` with what is set here. Not yet validated as a whole.
  GlobalMapOptions Over(GlobalMapOptions options) const;
  /// FAILED_PRECONDITION names the field and both values where a set field differs from the map's.
  absl::Status CheckAgainst(const GlobalMapOptions& map) const;
};

struct SessionSetup {
  std::string map;
  std::string robot;
  std::string session;
  Pose<Global, Odom> T_G_O;
  std::vector<SensorSetup> sensors;
  LocalMapSetup local_map;
  MapSetup map_setup;
};

inline constexpr int kSensors_max = 16;

/// These check each field by itself; options as a whole are validated when they are complete.
absl::StatusOr<MapSetup> FromProto(const v1::MapSetup& proto, const FieldPath& field);
absl::StatusOr<SessionSetup> FromProto(const v1::OpenSession& proto, const FieldPath& field);
absl::StatusOr<SensorSetup> FromProto(const v1::SensorSetup& proto, const FieldPath& field);

void ToProto(const MapSetup& setup, v1::MapSetup* proto);
void ToProto(const SessionSetup& setup, v1::OpenSession* proto);
/// The noise model becomes the sensor kind that reproduces it. Zeros, which on the wire mean the
/// default, become 1e-9.
void ToProto(const SensorSetup& sensor, v1::SensorSetup* proto);

}  // namespace gem::wire
