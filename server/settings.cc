#include "server/settings.h"

#include <type_traits>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "core/base/status_macros.h"

namespace gem {
namespace {

absl::Status Wrong(const std::string& name, const std::string& value, const char* want) {
  return absl::InvalidArgumentError(absl::StrCat(name, " is \"", value, "\", want ", want));
}

absl::Status Parse(const std::string& name, const std::string& value, bool& to) {
  return absl::SimpleAtob(value, &to) ? absl::OkStatus() : Wrong(name, value, "true or false");
}
absl::Status Parse(const std::string& name, const std::string& value, float& to) {
  return absl::SimpleAtof(value, &to) ? absl::OkStatus() : Wrong(name, value, "a number");
}
absl::Status Parse(const std::string& name, const std::string& value, double& to) {
  return absl::SimpleAtod(value, &to) ? absl::OkStatus() : Wrong(name, value, "a number");
}
absl::Status Parse(const std::string& /*name*/, const std::string& value, std::string& to) {
  to = value;
  return absl::OkStatus();
}
absl::Status Parse(const std::string& name, const std::string& value, LocalBackend& to) {
  const absl::StatusOr<LocalBackend> backend = ParseLocalBackend(value);
  if (!backend.ok()) return Wrong(name, value, "auto, cpu, cuda or reference");
  to = *backend;
  return absl::OkStatus();
}
template <typename T, typename = std::enable_if_t<std::is_integral_v<T>>>
absl::Status Parse(const std::string& name, const std::string& value, T& to) {
  return absl::SimpleAtoi(value, &to) ? absl::OkStatus() : Wrong(name, value, "a whole number");
}

std::string Format(bool value) { return value ? "true" : "false"; }
std::string Format(const std::string& value) { return value; }
std::string Format(LocalBackend value) { return std::string(NameOf(value)); }
template <typename T, typename = std::enable_if_t<std::is_arithmetic_v<T>>>
std::string Format(T value) {
  return absl::StrCat(value);
}

/// field(options) is the option's place.
template <typename Field>
Setting Make(const char* name, const char* help, Field field) {
  return {name, help,
          [=](const std::string& value, ServerOptions& options) {
            return Parse(name, value, field(options));
          },
          [=](const ServerOptions& options) {
            return Format(field(const_cast<ServerOptions&>(options)));
          }};
}

#define GEM_SETTING(name, path, help) \
  Make(                               \
      name, help, [](ServerOptions & options) -> auto& { return options.path; })

std::vector<Setting> MakeSettings() {
  return {
      GEM_SETTING("listen", listen, "gRPC address, ADDR:PORT; port 0 takes a free one"),
      GEM_SETTING("metrics_listen", metrics_listen,
                  "address of /metrics, ADDR:PORT; port 0 takes a free one"),
      GEM_SETTING("reflection", reflection, "clients may ask which services there are"),
      GEM_SETTING("log_level", log_level, "trace, debug, info, warn or error"),
      GEM_SETTING("backend", backend, "local mapper: auto, cpu, cuda or reference"),
      GEM_SETTING("local_threads", local_threads, "threads that work on one scan of a session"),

      GEM_SETTING("map.cell_size_m", map.cell_size_m, "edge of a cell of new maps, m"),
      GEM_SETTING("map.submap_length_m", map.submap_length_m, "path of one submap, m"),
      GEM_SETTING("map.traversable_only", map.traversable_only,
                  "submaps keep traversable cells only, as the paper does"),
      GEM_SETTING("map.traversability_free", map.traversability_free, "cells above this are free"),
      GEM_SETTING("map.compose_threads", map.compose_threads,
                  "threads that render one map's tiles"),
      GEM_SETTING("map.merge_overlap_min", map.merge_overlap_min,
                  "share of overlap from which submaps are merged; above 1: never"),
      GEM_SETTING("map.merge_fuse_time_s_max", map.merge_fuse_time_s_max,
                  "cells of merged submaps are fused within this time, s"),
      GEM_SETTING("map.merge_height_difference_m_max", map.merge_height_difference_m_max,
                  "submaps whose overlapping floors differ by more are not merged, m"),
      GEM_SETTING("map.gate_sigmas", map.gate_sigmas,
                  "submaps that differ by more disagree: the newer wins, standard deviations"),
      GEM_SETTING("map.odometry_poses_max", map.odometry_poses_max,
                  "poses kept of a session; beyond it the older half is thinned out"),
      GEM_SETTING("local_map.side_m", local_map.side_m, "edge of the robocentric window, m"),
      GEM_SETTING("local_map.range_m_min", local_map.range_m_min, "nearer points are ignored, m"),
      GEM_SETTING("local_map.range_m_max", local_map.range_m_max, "farther points are ignored, m"),
      GEM_SETTING("local_map.height_m_min", local_map.height_m_min,
                  "points lower over the base are ignored, m"),
      GEM_SETTING("local_map.height_m_max", local_map.height_m_max,
                  "points higher over the base are ignored, m"),
      GEM_SETTING("local_map.gate_sigmas", local_map.gate_sigmas,
                  "chi-square gate of eq. (5), standard deviations"),
      GEM_SETTING("local_map.variance_m2_min", local_map.variance_m2_min,
                  "a cell never becomes surer than this, m^2"),
      GEM_SETTING("local_map.variance_m2_max", local_map.variance_m2_max,
                  "a cell never becomes less sure than this, m^2"),
      GEM_SETTING("local_map.variance_growth_m2_per_s", local_map.variance_growth_m2_per_s,
                  "growth of the variance since the last observation, m^2/s"),
      GEM_SETTING("local_map.variance_growth_m2_per_m", local_map.variance_growth_m2_per_m,
                  "growth of the variance with the way since the last observation, m^2/m"),
      GEM_SETTING("local_map.below_gate_inflation", local_map.below_gate_inflation,
                  "factor on the variance of ground that was not seen where it is believed"),
      GEM_SETTING("local_map.slope_weight", local_map.slope_weight, "w_s of eq. (7)"),
      GEM_SETTING("local_map.roughness_weight", local_map.roughness_weight, "w_r of eq. (7)"),
      GEM_SETTING("local_map.slope_critical_rad", local_map.slope_critical_rad,
                  "critical slope of eq. (7), rad"),
      GEM_SETTING("local_map.roughness_critical_m", local_map.roughness_critical_m,
                  "critical roughness of eq. (7), m"),
      GEM_SETTING("local_map.plane_cells_min", local_map.plane_cells_min,
                  "known cells of 5x5 without which no slope is told"),
      GEM_SETTING("local_map.clear_sigmas", local_map.clear_sigmas,
                  "a ray clears what is surely above it: by so many standard deviations"),
      GEM_SETTING("pose_sigma_rotation_rad", pose_sigma_rotation_rad,
                  "deviation of poses without covariance, rad"),
      GEM_SETTING("pose_sigma_translation_m", pose_sigma_translation_m,
                  "deviation of poses without covariance, m"),

      GEM_SETTING("publish_hz", publish_hz, "how often live data enters the map, Hz"),
      GEM_SETTING("local_publish_hz", local_publish_hz,
                  "how often a busy session copies its local map, Hz"),
      GEM_SETTING("session_idle_s_max", session_idle_s_max,
                  "a session without a stream ends after so long, s"),
      GEM_SETTING("pose_wait_s_max", pose_wait_s_max,
                  "a scan waits so long for streamed poses around it, s"),
      GEM_SETTING("overload_age_s_max", overload_age_s_max,
                  "scans that have waited longer give way, if the robot wants it so, s"),

      GEM_SETTING("sessions_max", sessions_max, "sessions that are open at once"),
      GEM_SETTING("ended_sessions_max", ended_sessions_max, "ended sessions that are remembered"),
      GEM_SETTING("sessions_per_map_max", sessions_per_map_max, "sessions that ever feed one map"),
      GEM_SETTING("maps_max", maps_max, "maps"),
      GEM_SETTING("scan_bytes_max", scan_bytes_max, "bytes of the points of one scan"),
      GEM_SETTING("points_max", points_max, "points of one scan"),
      GEM_SETTING("queue_bytes_max", queue_bytes_max, "bytes that wait for one session"),
      GEM_SETTING("ingest_bytes_max", ingest_bytes_max,
                  "bytes that wait for all sessions together"),
      GEM_SETTING("waiting_scans_max", waiting_scans_max,
                  "scans of one session that wait for poses"),
      GEM_SETTING("message_bytes_max", message_bytes_max, "bytes of any message"),
      GEM_SETTING("streams_per_connection_max", streams_per_connection_max,
                  "calls on one connection"),
      GEM_SETTING("finished_submaps_waiting_max", finished_submaps_waiting_max,
                  "finished submaps of one session that wait for the map"),
      GEM_SETTING("corrections_waiting_max", corrections_waiting_max,
                  "corrections of one map that wait for publication"),
      GEM_SETTING("request_ids_max", request_ids_max, "answers remembered by request id, a map"),
      GEM_SETTING("commit_restarts_max", commit_restarts_max,
                  "how often newer corrections may stop one rendering"),
      GEM_SETTING("revision_retention_s", revision_retention_s,
                  "a replaced revision of a map can be read for so long, s"),
      GEM_SETTING("revision_bytes_max", revision_bytes_max,
                  "bytes that only replaced revisions hold, a map"),
      GEM_SETTING("tile_cache_bytes_max", tile_cache_bytes_max,
                  "encoded tiles and local maps that are kept, bytes"),
      GEM_SETTING("readers_max", readers_max, "streams to readers at once"),
      GEM_SETTING("transfers_max", transfers_max, "maps that are exported and imported at once"),
      GEM_SETTING("import_bytes_max", import_bytes_max, "bytes of a file of a map"),
      GEM_SETTING("import_memory_bytes_max", import_memory_bytes_max,
                  "bytes that an imported map may take in memory"),
      GEM_SETTING("worker_threads", worker_threads, "threads that encode tiles"),
      GEM_SETTING("worker_queue_max", worker_queue_max, "requests that wait for those threads"),
      GEM_SETTING("admin_threads", admin_threads, "threads that delete and import maps"),
  };
}

#undef GEM_SETTING

}  // namespace

const std::vector<Setting>& Settings() {
  static const std::vector<Setting> settings = MakeSettings();
  return settings;
}

const Setting* FindSetting(const std::string& name) {
  for (const Setting& setting : Settings())
    if (setting.name == name) return &setting;
  return nullptr;
}

}  // namespace gem
