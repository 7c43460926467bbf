// gem bench local: times the local mapper in this process over a recorded KITTI directory, stage by
// stage, against the time it takes to read every point once.
#pragma once

#include <cstddef>
#include <functional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/scan_source.h"
#include "core/local/local_mapper.h"

namespace CLI {
class App;
}

namespace gem::client {

/// Milliseconds of the scans of one run.
struct Distribution_ms {
  double median = 0;
  double p95 = 0;
};
/// Of values in any order. Zero of none.
Distribution_ms DistributionOf(std::vector<double> values_ms);

struct LocalBench {
  std::string backend;
  std::size_t num_scans = 0;
  std::size_t points = 0;   ///< median of a scan
  std::size_t cells = 0;    ///< of the window
  double read_pass_ms = 0;  ///< median: every point's x, y, z summed
  Distribution_ms total;
  Distribution_ms move, measure, fuse, annotate, clear;
};

/// Runs a fresh mapper over the source's next scans, at most num_scans_max of them. NOT_FOUND if it
/// has none.
absl::StatusOr<LocalBench> BenchLocal(ScanSource& source, LocalBackend backend,
                                      const LocalMapOptions& options, std::size_t num_scans_max);

std::string BenchJson(const LocalBench& bench);
std::string BenchTable(const LocalBench& bench);

void AddBenchCommand(CLI::App& app, std::function<absl::Status()>& run);

}  // namespace gem::client
