// What a map that is read from a file may be at most.
#pragma once

#include <cstdint>

namespace gem::map_file {

struct Limits {
  std::uint64_t file_bytes_max = std::uint64_t{1} << 30;
  /// Of trajectories, submaps and local maps, tiles not counted.
  std::uint64_t memory_bytes_max = std::uint64_t{4} << 30;
  std::uint64_t sessions_max = 10'000;
  /// Of one session; the map keeps no more later on.
  int odometry_poses_max = 1'000'000;
  int compose_threads = 2;  ///< of the map
};

}  // namespace gem::map_file
