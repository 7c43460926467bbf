// What a server can serve on this machine, measured from outside: tiles read while robots stream,
// and scans taken in beside what a bare gRPC stream takes. Load and server are processes of one
// machine and share its cores.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "client/load/scan_tape.h"

namespace gem::load {

struct ServingOptions {
  int robots_max = 12;
  double seconds = 8;  ///< of one measurement with robots
  double flood_s = 2;  ///< of one measurement of ingest
  int rounds = 5;      ///< of ingest; bare and full server take turns
  int readers = 2;
  int tiles_per_call = 16;
  double paced_calls_hz = 100;
  double watch_s = 60;  ///< of one measurement with watchers
};

struct Milliseconds {
  double p50 = 0;
  double p99 = 0;
  double max = 0;
};
/// Of values in any order. Zero of none.
Milliseconds MillisecondsOf(std::vector<double> seconds);

/// Robots that stream at 10 Hz.
struct RobotsResult {
  int num_robots = 0;
  std::uint64_t num_scans = 0;
  std::uint64_t num_late = 0;  ///< acknowledged more than 100 ms after they were due
  std::uint64_t num_refused = 0;
  Milliseconds scan;  ///< from due to acknowledged
};

/// Of one kind of reading, while robots stream.
struct ReadResult {
  int tiles_per_call = 0;
  double calls_hz = 0;
  double tiles_hz = 0;
  double bytes_hz = 0;
  Milliseconds call;
  RobotsResult robots;
  double server_cores = 0;  ///< processor time over time
  double load_cores = 0;
};

struct ReadingBench {
  std::size_t num_tiles = 0;  ///< of the map that is read
  /// The largest number of robots of which 99 % of the scans are in time, beside paced readers.
  int robots_sustained = 0;
  std::vector<ReadResult> paced;    ///< without robots, then with every number that was tried
  std::vector<ReadResult> flooded;  ///< without robots, then with robots_sustained
};

absl::StatusOr<ReadingBench> BenchReading(const ScanTape& tape, const ServingOptions& options);

/// Scans that are received; medians of the rounds.
struct IngestRate {
  double scans_hz = 0;
  double share = 1;   ///< of what a bare stream receives in the same round
  double cpu_ms = 0;  ///< processor time of the process that receives, a scan
};

/// One stream, or several at once, as fast as they go.
struct IngestResult {
  std::string encoding;
  int num_streams = 0;
  double bytes_per_scan = 0;
  IngestRate bare;  ///< read, parsed and acknowledged by a gRPC stream that does nothing else
  /// Everything but the mapping: queued, validated, decoded, and then refused for want of a pose.
  IngestRate taken;
  IngestRate mapped;  ///< fused into local maps and the global map
};

/// INTERNAL if the server refuses a scan that it should fuse, or fuses one that has no pose.
absl::StatusOr<IngestResult> BenchIngest(const ScanTape& tape, const std::string& encoding,
                                         int num_streams, const ServingOptions& options);

/// Watchers of a map in which a robot drives.
struct WatchResult {
  int num_watchers = 0;
  int num_silent = 0;  ///< of them, that never read
  double messages_hz = 0;
  double bytes_hz = 0;
  // Resident memory of the server.
  double median_bytes = 0;
  double growth_bytes = 0;  ///< over the measurement, robust
  double max_bytes = 0;
  RobotsResult robots;
};

/// The last of the watchers never reads. UNIMPLEMENTED if the server knows no watching.
absl::StatusOr<WatchResult> BenchWatching(const ScanTape& tape, int num_watchers,
                                          const ServingOptions& options);

}  // namespace gem::load
