// What planners ask about the ground of a map, and the answers. Plain values that core, wire and
// client share; how they are found is core/global/terrain_reader.h and path_check.h.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <variant>
#include <vector>

#include "core/grid/map_version.h"
#include "core/grid/region.h"

namespace gem {

/// From best to worst. Neither unknown nor known of height only is ever to be taken for free.
enum class GroundState : std::uint8_t { kFree, kHeightOnly, kUnknown, kObstacle };

/// The ground at one place. Values of what is not known are zero.
struct GroundSample {
  GroundState state = GroundState::kUnknown;
  float elevation_m = 0;     ///< over z = 0 of G; unless unknown
  float variance_m2 = 0;     ///< of the elevation; unless unknown
  float traversability = 0;  ///< of a free cell or an obstacle
  /// Of a plane through the known ones of the 3x3 cells around; nothing unless the place is known
  /// and they span a plane.
  std::optional<float> slope_rad;

  bool annotated() const { return state == GroundState::kFree || state == GroundState::kObstacle; }
  friend bool operator==(const GroundSample&, const GroundSample&) = default;
};

/// What a robot covers of the ground, a closed set in B.
struct Disc {
  double radius_m = 0;  ///< about B; zero: a point
};
/// x points along the path, y to its left.
struct Rectangle {
  double x_m_min = 0, y_m_min = 0, x_m_max = 0, y_m_max = 0;
};
using Footprint = std::variant<Disc, Rectangle>;

struct PathQuestion {
  std::vector<Place> path;  ///< corners, at least one
  Footprint footprint;
  double step_m = 0;  ///< samples are at most so far apart; 0: a cell
};

// What is examined at most. Constants of the protocol.
inline constexpr std::size_t kGroundPoints_max = 65'536;  ///< of one SampleHeights
inline constexpr std::size_t kPathCorners_max = 4096;
inline constexpr std::size_t kPathSamples_max = 65'536;
inline constexpr double kPathLengthMax_m = 10'000;
inline constexpr double kFootprintMax_m = 10;  ///< reach from B along any axis

/// One sample of a path. What it says of the footprint holds for all that the robot covers on its
/// way from the sample before.
struct PathSample {
  double distance_m = 0;  ///< from the start along the path
  Place position;         ///< of B
  GroundSample ground;    ///< under B
  GroundState worst = GroundState::kFree;
  float traversability_min = 0;  ///< of cells that have one; 0 if none has
  float slope_rad_max = 0;       ///< of cells that have one; 0 if none has
  float unknown_share = 0;       ///< of the cells: unknown or of known height only
};

struct WorstCell {
  Place position;  ///< its middle
  GroundSample ground;
  std::size_t sample = 0;  ///< the first that covers it
};

struct PathCheck {
  std::vector<PathSample> samples;
  bool free = false;  ///< every cell of every sample is
  WorstCell worst;
  double free_distance_m = 0;  ///< up to the last sample before the first that is not free
};

}  // namespace gem
