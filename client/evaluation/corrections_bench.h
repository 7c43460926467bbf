// Corrects a large map many times a second while its robot goes on streaming, through a gem_server
// of its own: what corrections cost the local mapper, and whether the map that is published last is
// the one that the last correction alone gives. Serves `gem bench corrections`.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "absl/status/statusor.h"
#include "client/evaluation/local_bench.h"

namespace gem::evaluation {

struct CorrectionsBenchOptions {
  double way_m = 3700;         ///< mapped before, KITTI 00's. Range [20, 100000]
  double width_m = 12;         ///< of the local map and the mapped strip. Range [2, 100]
  double seconds = 60;         ///< of corrections; as long without. Range [0.1, 3600]
  double block_s = 3;          ///< with and without by turns. Range [0.1, 60]
  double corrections_hz = 10;  ///< Range [0.1, 100]
};

/// Of the scans that were streamed in half of the time.
struct StreamTiming {
  std::size_t num_scans = 0;
  Distribution_ms mapper;  ///< all stages of the local mapper
  Distribution_ms fused;   ///< from the robot's sending to its acknowledgement
};

struct CorrectionsBench {
  std::size_t num_submaps = 0;
  std::size_t num_points = 0;  ///< cells in submaps
  std::size_t num_corrections = 0;
  double corrections_hz = 0;  ///< that were sent
  StreamTiming without, with;
  Distribution_ms published;  ///< from a correction's sending to the answer that it is published
  std::size_t num_cells = 0;  ///< of the map in the end
  /// Cells that are not what the same scans and the last correction alone give.
  std::size_t num_different_cells = 0;
};

/// INVALID_ARGUMENT names the option; NOT_FOUND without a gem_server beside this program.
absl::StatusOr<CorrectionsBench> BenchCorrections(const CorrectionsBenchOptions& options);

std::string CorrectionsBenchJson(const CorrectionsBench& bench);
std::string CorrectionsBenchTable(const CorrectionsBench& bench);

}  // namespace gem::evaluation
