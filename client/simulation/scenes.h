// The worlds that come with the simulator, by name, each with a robot that drives through it.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "client/simulation/simulated_source.h"

namespace gem {

struct SceneOptions {
  /// One of SceneList().
  std::string name = "block";
  /// Same seed, same bytes.
  std::uint64_t seed = 1;
  /// Rings of the LiDAR, from +2 to -24.8 degrees. Range [1, 256].
  int rings = 64;
  /// Beams of a ring in one turn. Range [8, 8192].
  int azimuths = 1024;
  /// At most so many scans; 0: as many as the scene has. Range [0, 1000000].
  int scans_max = 0;
  /// Metres of path from one scan to the next; nothing: the scene's own. 0: the robot stands, for
  /// scans_max scans (40 if that is 0). Range [0, 10].
  std::optional<double> scan_spacing_m = std::nullopt;
  /// Factor on the drift of the odometry; 0: odometry is the truth. Range [0, 100].
  double drift_scale = 1.0;
  /// Factor on the noise of ranges and on the share of lost beams; 0: neither. Range [0, 20].
  double noise_scale = 1.0;
  /// ESRI ASCII grid; scene `terrain` needs it, the others refuse it.
  std::string terrain_file = {};
};

struct SceneInfo {
  std::string name;
  std::string description;  ///< one line, for --help
};

/// Every scene, in the order in which --help lists them.
const std::vector<SceneInfo>& SceneList();

/// INVALID_ARGUMENT names the field, its value and the limit; an unknown name is answered with the
/// list of known ones. Errors of the terrain file are those of its reader.
absl::StatusOr<std::unique_ptr<SimulatedSource>> MakeScene(const SceneOptions& options);

}  // namespace gem
