// Options of gem_server, with unit, default, range and reason. Where they come from (flags, a file)
// is settings.h.
#pragma once

#include <cstdint>
#include <string>

#include "absl/status/status.h"
#include "core/global/global_map_options.h"
#include "core/local/local_map_options.h"
#include "core/local/local_mapper.h"

namespace gem {

struct ServerOptions {
  /// Where gRPC listens, ADDR:PORT. Port 0 takes a free one.
  std::string listen = "127.0.0.1:50051";
  /// Where /metrics listens, ADDR:PORT. Port 0 takes a free one.
  std::string metrics_listen = "127.0.0.1:9464";
  /// True: clients may ask which services there are (grpcurl, buf curl).
  bool reflection = true;
  /// Least severe messages that are logged: trace, debug, info, warn, error.
  std::string log_level = "info";

  /// Where there is no device for kCuda or kAuto, the server says so once and takes kCpu.
  LocalBackend backend = LocalBackend::kCpu;
  /// Threads that work on one scan of a session; the map is the same for any number. One serves the
  /// most robots per core, more the fastest scan of a single robot. Range [1, 64].
  int local_threads = 1;
  /// Defaults of sessions that do not say otherwise.
  LocalMapOptions local_map;
  /// Defaults of maps that do not say otherwise.
  GlobalMapOptions map;
  /// Deviation of a pose that comes without covariance, radians: no odometry is exact, and a zero
  /// would make far cells too sure. Range [0, 1].
  double pose_sigma_rotation_rad = 0.002;
  /// The same for the translation, metres. Range [0, 100].
  double pose_sigma_translation_m = 0.01;

  // Rates.
  /// How often live data enters the published map. Corrections and session ends do not wait. Range
  /// (0, 100].
  double publish_hz = 2.0;
  /// How often a busy session copies its local map for readers. Range (0, 100].
  double local_publish_hz = 10.0;

  // Times.
  /// A session without a stream ends after so long; what it holds enters the map. Seconds, range
  /// (0, 1e6].
  double session_idle_s_max = 600.0;
  /// A scan waits so long for streamed poses around its stamp or its points' times; then it is
  /// refused. Seconds, range [0, 10].
  double pose_wait_s_max = 0.2;

  /// Of a robot that would rather drop scans than wait: one that has waited longer gives way to
  /// newer ones. Two periods of a 10 Hz LiDAR: the newest is fused soon, and scans that come in a
  /// burst, which wait for milliseconds, stay. Seconds, range [0, 60].
  double overload_age_s_max = 0.2;

  // Limits.
  /// Sessions that are open at once; each has a thread. Range [1, 10000].
  int sessions_max = 64;
  /// Ended sessions whose status and last local map are kept. Range [1, 10000].
  int ended_sessions_max = 256;
  /// Sessions that ever fed one map: their trajectories are kept for corrections. Range [1, 1e6].
  int sessions_per_map_max = 10'000;
  /// Maps; each has a thread. Range [1, 10000].
  int maps_max = 64;
  /// Bytes of the points of one scan. Range [1, 2^30].
  std::uint64_t scan_bytes_max = 16u << 20;
  /// Points of one scan. Range [1, 1e8].
  std::uint32_t points_max = 2'000'000;
  /// Bytes that wait for one session; the credit that a robot gets. Range [scan_bytes_max, 2^32].
  std::uint64_t queue_bytes_max = 64u << 20;
  /// Bytes that wait for all sessions together. A session that floods the server gets half of it at
  /// most, n of them an (n + 1)th each; one scan's worth is everybody's, however little is left.
  /// Range [scan_bytes_max, 2^40].
  std::uint64_t ingest_bytes_max = 512u << 20;
  /// Scans of one session that wait for poses, in half of queue_bytes_max; then the oldest is
  /// refused. Range [1, 10000].
  int waiting_scans_max = 100;
  /// Any message. Above the largest scan, so that an oversized scan is refused by name instead of
  /// breaking the stream, and above a correction of a million poses. Range (scan_bytes_max, 2^31).
  std::uint64_t message_bytes_max = 96u << 20;
  /// Streams of one connection. Range [1, 1e6].
  int streams_per_connection_max = 256;
  /// Finished submaps of one session that wait for the map; then the session waits. Range [1, 1e6].
  int finished_submaps_waiting_max = 64;
  /// Corrections of one map that wait for publication. Range [1, 1e6].
  int corrections_waiting_max = 1000;
  /// Answers that are remembered by request id, a map. Range [1, 1e6].
  int request_ids_max = 1000;
  /// Newer corrections may stop a rendering in hand so often; then one is let through. Range [0,
  /// 1000].
  int commit_restarts_max = 8;
  /// A revision of a map can be read for so long after a newer one replaced it. Seconds, range [0,
  /// 3600].
  double revision_retention_s = 30.0;
  /// Bytes of what only such replaced revisions hold, a map; then the oldest is forgotten early. A
  /// correction of the whole map replaces every tile: half a megabyte each. Range [0, 2^40].
  std::uint64_t revision_bytes_max = 256u << 20;
  /// Encoded tiles and local maps that are kept for whoever asks next, bytes. Range [0, 2^40].
  std::uint64_t tile_cache_bytes_max = 128u << 20;
  /// Streams to readers at once: WatchTiles, StreamTiles, WatchLocalMap. One that does not read
  /// holds some hundred kilobytes. Range [1, 1e6].
  int readers_max = 1000;
  /// Maps that are exported and imported at once; each holds the state of a map. Range [1, 1000].
  int transfers_max = 4;
  /// A file of a map that is imported. Bytes, range [1, 2^40].
  std::uint64_t import_bytes_max = std::uint64_t{1} << 30;
  /// What an imported map may take in memory, tiles included: files are compressed. Bytes, range
  /// [1, 2^44].
  std::uint64_t import_memory_bytes_max = std::uint64_t{4} << 30;
  /// Threads that encode tiles. Range [1, 64].
  int worker_threads = 2;
  /// Requests that wait for those threads, for the one that converts corrections, and for the next
  /// ones; each by itself. Range [1, 1e6].
  int worker_queue_max = 256;
  /// Threads that delete maps, which waits for threads, and import them: no reader of tiles waits
  /// behind it. Range [1, 64].
  int admin_threads = 2;
};

/// INVALID_ARGUMENT: "sessions_max is 0, want [1, 10000]".
absl::Status Validate(const ServerOptions& options);

}  // namespace gem
