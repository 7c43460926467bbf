// A server under everything at once, for minutes: robots that come, are cut off, resume, correct
// and go; planners and watchers that come and go; maps that are made and deleted under them.
// Watches the server's process for anything that grows.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/load/growth.h"
#include "client/load/scan_tape.h"

namespace gem::load {

struct SoakOptions {
  double seconds = 600;
  /// Not counted: until buffers and maps are as large as they get.
  double warm_up_s = 120;
  int robots = 4;
  int planners = 2;
  int watchers = 4;
  std::uint64_t seed = 1;
};

struct SoakCounts {
  std::uint64_t sessions = 0;
  std::uint64_t cuts = 0;  ///< streams that were broken off; half of them came back
  std::uint64_t scans = 0;
  std::uint64_t corrections = 0;
  std::uint64_t tiles = 0;
  std::uint64_t watches = 0;
  std::uint64_t maps_deleted = 0;
  std::uint64_t refusals = 0;  ///< by a map that went away meanwhile, and the like
};

/// What was sampled of the server once a second.
struct SoakGrowth {
  Growth resident_bytes;
  Growth threads;
  Growth open_files;
};

struct SoakReport {
  double seconds = 0;
  std::size_t num_samples = 0;
  SoakCounts counts;
  SoakGrowth growth;
  int exit_code = 0;  ///< of the server when it was told to go
};

/// An error if the server answers with what it must never answer with (INTERNAL, UNKNOWN,
/// DATA_LOSS), or dies.
absl::StatusOr<SoakReport> Soak(const ScanTape& tape, const SoakOptions& options);

/// OK if nothing grew: memory by at most 5 % or 8 MiB, threads and open files by at most 3.
absl::Status JudgeSoak(const SoakReport& report);

}  // namespace gem::load
