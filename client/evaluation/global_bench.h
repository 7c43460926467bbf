// Times the global mapper on a map of a given length: corrections that bend all of it, and the rate
// at which tiles are composed. No scans: submaps are filled with made-up ground. Serves
// `gem bench global`.
#pragma once

#include <cstddef>
#include <string>

#include "absl/status/statusor.h"
#include "client/evaluation/local_bench.h"

namespace gem::evaluation {

struct GlobalBenchOptions {
  double way_m = 3700;  ///< KITTI 00's. Range [100, 100000]
  double width_m = 12;  ///< of the mapped strip. Range [1, 100]
  float cell_size_m = 0.2f;
  float submap_length_m = 10;
  int threads = 2;           ///< that render tiles. Range [1, 64]
  int num_corrections = 20;  ///< Range [1, 10000]
};

struct GlobalBench {
  std::size_t num_submaps = 0;
  std::size_t num_points = 0;         ///< cells in submaps
  std::size_t size_bytes = 0;         ///< of submaps
  std::size_t num_tiles = 0;          ///< of level 0
  std::size_t num_coarser_tiles = 0;  ///< of all other levels
  // Of one correction that moves every submap.
  std::size_t num_touched_tiles = 0;  ///< median
  Distribution_ms correction = {};    ///< from Correct() until the snapshot is published
  Distribution_ms deform = {}, merge = {}, compose = {}, coarsen = {};
  double known_cells_per_s = 0;  ///< rendered, by all threads
  double tile_cells_per_s = 0;   ///< unknown ones included
  // Of one correction that moves the last tenth of the way only.
  std::size_t num_touched_tiles_of_tenth = 0;
  Distribution_ms correction_of_tenth = {};
};

/// INVALID_ARGUMENT names the option.
absl::StatusOr<GlobalBench> BenchGlobal(const GlobalBenchOptions& options);

std::string GlobalBenchJson(const GlobalBench& bench);
std::string GlobalBenchTable(const GlobalBench& bench);

}  // namespace gem::evaluation
