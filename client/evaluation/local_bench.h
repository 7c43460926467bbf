// Times the local mapper over a source of scans, stage by stage, against the time it takes to read
// every point once. Serves `gem bench local` and Table II.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "client/scan_source.h"
#include "core/local/local_mapper.h"

namespace gem::evaluation {

/// Milliseconds of the scans of one run.
struct Distribution_ms {
  double median = 0;
  double p95 = 0;
  double p99 = 0;
};
/// Of values in any order. Zero of none.
Distribution_ms DistributionOf(std::vector<double> values_ms);

struct LocalBench {
  std::string backend = {};
  std::size_t num_scans = 0;
  std::size_t points = 0;            ///< median of a scan
  std::size_t points_in_window = 0;  ///< of them over the window and in its height; median
  std::size_t cells = 0;             ///< of the window
  double read_pass_ms = 0;           ///< median: every point's x, y, z summed
  Distribution_ms total = {};
  Distribution_ms move = {}, measure = {}, fuse = {}, annotate = {}, clear = {};
};

/// One scan's way through a mapper.
struct ScanTiming {
  double read_pass_s = 0;
  ScanReport report = {};
};

/// Runs a fresh mapper over the source's next scans, at most num_scans_max of them. NOT_FOUND if it
/// has none. Reading a scan from its file is not timed.
absl::StatusOr<std::vector<ScanTiming>> TimeScans(ScanSource& source, LocalBackend backend,
                                                  const LocalMapOptions& options,
                                                  std::size_t num_scans_max, int threads = 1);

LocalBench Summarise(LocalBackend backend, const LocalMapOptions& options,
                     const std::vector<ScanTiming>& scans);

/// Times the scans and summarises them. Errors are those of TimeScans().
absl::StatusOr<LocalBench> BenchLocal(ScanSource& source, LocalBackend backend,
                                      const LocalMapOptions& options, std::size_t num_scans_max,
                                      int threads = 1);

}  // namespace gem::evaluation
