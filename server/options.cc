#include "server/options.h"

#include <algorithm>
#include <array>

#include "absl/strings/str_cat.h"
#include "core/base/status_macros.h"

namespace gem {
namespace {

template <typename T>
absl::Status InRange(const char* name, T value, T low, T high) {
  // Written so that NaN is refused.
  if (value >= low && value <= high) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrCat(name, " is ", value, ", want [", low, ", ", high, "]"));
}

absl::Status ValidateLimits(const ServerOptions& options) {
  GEM_RETURN_IF_ERROR(InRange("sessions_max", options.sessions_max, 1, 10'000));
  GEM_RETURN_IF_ERROR(InRange("ended_sessions_max", options.ended_sessions_max, 1, 10'000));
  GEM_RETURN_IF_ERROR(InRange("sessions_per_map_max", options.sessions_per_map_max, 1, 1'000'000));
  GEM_RETURN_IF_ERROR(InRange("maps_max", options.maps_max, 1, 10'000));
  GEM_RETURN_IF_ERROR(
      InRange<std::uint64_t>("scan_bytes_max", options.scan_bytes_max, 1, 1u << 30));
  GEM_RETURN_IF_ERROR(InRange<std::uint32_t>("points_max", options.points_max, 1, 100'000'000));
  GEM_RETURN_IF_ERROR(InRange<std::uint64_t>("queue_bytes_max", options.queue_bytes_max,
                                             options.scan_bytes_max, std::uint64_t{1} << 32));
  GEM_RETURN_IF_ERROR(InRange<std::uint64_t>("ingest_bytes_max", options.ingest_bytes_max,
                                             options.scan_bytes_max, std::uint64_t{1} << 40));
  GEM_RETURN_IF_ERROR(InRange("waiting_scans_max", options.waiting_scans_max, 1, 10'000));
  GEM_RETURN_IF_ERROR(InRange<std::uint64_t>("message_bytes_max", options.message_bytes_max,
                                             options.scan_bytes_max + 1,
                                             (std::uint64_t{1} << 31) - 1));
  GEM_RETURN_IF_ERROR(
      InRange("streams_per_connection_max", options.streams_per_connection_max, 1, 1'000'000));
  GEM_RETURN_IF_ERROR(
      InRange("finished_submaps_waiting_max", options.finished_submaps_waiting_max, 1, 1'000'000));
  GEM_RETURN_IF_ERROR(
      InRange("corrections_waiting_max", options.corrections_waiting_max, 1, 1'000'000));
  GEM_RETURN_IF_ERROR(InRange("request_ids_max", options.request_ids_max, 1, 1'000'000));
  GEM_RETURN_IF_ERROR(InRange("commit_restarts_max", options.commit_restarts_max, 0, 1000));
  GEM_RETURN_IF_ERROR(InRange("revision_retention_s", options.revision_retention_s, 0.0, 3600.0));
  GEM_RETURN_IF_ERROR(InRange<std::uint64_t>("revision_bytes_max", options.revision_bytes_max, 0,
                                             std::uint64_t{1} << 40));
  GEM_RETURN_IF_ERROR(InRange<std::uint64_t>("tile_cache_bytes_max", options.tile_cache_bytes_max,
                                             0, std::uint64_t{1} << 40));
  GEM_RETURN_IF_ERROR(InRange("readers_max", options.readers_max, 1, 1'000'000));
  GEM_RETURN_IF_ERROR(InRange("transfers_max", options.transfers_max, 1, 1000));
  GEM_RETURN_IF_ERROR(InRange<std::uint64_t>("import_bytes_max", options.import_bytes_max, 1,
                                             std::uint64_t{1} << 40));
  GEM_RETURN_IF_ERROR(InRange<std::uint64_t>(
      "import_memory_bytes_max", options.import_memory_bytes_max, 1, std::uint64_t{1} << 44));
  GEM_RETURN_IF_ERROR(InRange("local_threads", options.local_threads, 1, kLocalThreadsMax));
  GEM_RETURN_IF_ERROR(InRange("worker_threads", options.worker_threads, 1, 64));
  GEM_RETURN_IF_ERROR(InRange("admin_threads", options.admin_threads, 1, 64));
  return InRange("worker_queue_max", options.worker_queue_max, 1, 1'000'000);
}

}  // namespace

absl::Status Validate(const ServerOptions& options) {
  constexpr std::array<const char*, 5> kLevels = {"trace", "debug", "info", "warn", "error"};
  if (std::find(kLevels.begin(), kLevels.end(), options.log_level) == kLevels.end())
    return absl::InvalidArgumentError(absl::StrCat("log_level is \"", options.log_level,
                                                   "\", want trace, debug, info, warn or error"));
  GEM_RETURN_IF_ERROR(Validate(options.map));
  LocalMapOptions local_map = options.local_map;
  local_map.cell_size_m = options.map.cell_size_m;  // sessions inherit the cell of the map
  GEM_RETURN_IF_ERROR(Validate(local_map));
  GEM_RETURN_IF_ERROR(
      InRange("pose_sigma_rotation_rad", options.pose_sigma_rotation_rad, 0.0, 1.0));
  GEM_RETURN_IF_ERROR(
      InRange("pose_sigma_translation_m", options.pose_sigma_translation_m, 0.0, 100.0));
  GEM_RETURN_IF_ERROR(InRange("publish_hz", options.publish_hz, 0.001, 100.0));
  GEM_RETURN_IF_ERROR(InRange("local_publish_hz", options.local_publish_hz, 0.001, 100.0));
  GEM_RETURN_IF_ERROR(InRange("session_idle_s_max", options.session_idle_s_max, 0.001, 1e6));
  GEM_RETURN_IF_ERROR(InRange("pose_wait_s_max", options.pose_wait_s_max, 0.0, 10.0));
  GEM_RETURN_IF_ERROR(InRange("overload_age_s_max", options.overload_age_s_max, 0.0, 60.0));
  return ValidateLimits(options);
}

}  // namespace gem
