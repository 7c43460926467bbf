// Whether a robot can follow a path on a published map, and where it is worst. One pass over the
// cells under the footprint; searching for a path is the planner's.
#pragma once

#include <cstddef>
#include <vector>

#include "absl/status/statusor.h"
#include "core/global/map_snapshot.h"
#include "core/global/swept_footprint.h"
#include "core/global/terrain_reader.h"
#include "core/grid/terrain.h"

namespace gem {

/// Cells that one answer looks at, counted as often as a footprint covers them: a third of a
/// second. A robot of 2 x 1 m on 10 km of cells of 0.2 m takes 3.6 million.
inline constexpr std::size_t kPathCells_max = std::size_t{1} << 22;

/// B moves straight ahead, or stands and looks along the heading.
struct PathStep {
  Place from;
  Place to;  ///< where the sample is
  Heading heading;
  double distance_m = 0;  ///< of `to` from the start along the path
};

/// The steps from sample to sample. The first stands at the start. Every corner ends a step; at a
/// corner a rectangle turns on the spot, the shorter way, in steps that move none of its corners
/// by more than step_m. A path of one place looks along x of G. INVALID_ARGUMENT names step_m if
/// there are more than kPathSamples_max. Corners lie within 1e6 m, and the path is at most
/// kPathLengthMax_m long.
absl::StatusOr<std::vector<PathStep>> WalkPath(const PathQuestion& question, double cell_size_m);

/// INVALID_ARGUMENT names step_m, or path if more than kPathCells_max cells would have to be looked
/// at; CANCELLED if abandoned. The question is as WalkPath() and wire want it.
absl::StatusOr<PathCheck> CheckPath(const MapSnapshot& map, const PathQuestion& question,
                                    Abandoned abandoned);

}  // namespace gem
