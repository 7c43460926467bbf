// What happened on a server between two looks at it: rates, times, growth. Numbers only, without a
// terminal (top_screen.h) or a connection.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "client/map_types.h"

namespace gem::client {

/// One look.
struct TopSample {
  ServerStatus status;
  std::vector<MapInfo> maps;
};

/// Of what ran in the interval. From buckets: quantiles are interpolated, and NaN if nothing ran.
struct TimesMs {
  double mean = 0;
  double p50 = 0;
  double p99 = 0;
  double max = 0;  ///< an upper bound, exact if it is the longest since the start
};

/// A session that has not ended.
struct RobotRates {
  std::string map;
  std::string robot;
  std::string session;
  bool connected = false;
  double scans_hz = 0;
  double refused_hz = 0;
  std::uint64_t queue_bytes = 0;
  double lag_s = 0;  ///< age of the oldest scan that waits or is in hand
};

struct MapRates {
  std::string map;
  std::uint64_t num_submaps = 0;
  std::uint64_t num_points = 0;
  std::uint64_t num_tiles = 0;
  std::uint64_t submap_bytes = 0;
  std::uint64_t revision = 0;
  double revisions_hz = 0;
  double points_hz = 0;  ///< growth; negative where submaps are merged
  double staleness_s = 0;
  std::uint32_t num_corrections_waiting = 0;
};

/// A stage that ever ran.
struct StageRates {
  std::string mapper;
  std::string stage;
  double runs_hz = 0;
  TimesMs times;
};

/// An RPC that was ever called.
struct CallRates {
  std::string method;
  double calls_hz = 0;
  double failed_hz = 0;
  std::uint32_t num_active = 0;
  double received_bytes_hz = 0;
  double sent_bytes_hz = 0;
  TimesMs times;  ///< of those that ended; no max is known
};

struct TopRates {
  std::string server_version;
  std::string backend;
  double uptime_s = 0;
  double interval_s = 0;
  double cpu_cores = 0;  ///< processor time over time
  ProcessStatus process;
  double tiles_hz = 0;  ///< with cells
  double absent_tiles_hz = 0;
  std::size_t num_ended_sessions = 0;
  std::vector<RobotRates> robots;  ///< by map, robot, session
  std::vector<MapRates> maps;
  std::vector<StageRates> stages;
  std::vector<CallRates> calls;
};

/// Time is the server's. If it was started anew in between, everything counts from its start.
TopRates RatesBetween(const TopSample& before, const TopSample& now);

}  // namespace gem::client
