// Ground that was passed twice: where a drive closes loops, and how far apart in height the passes
// lie in the map.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "client/evaluation/submap_run.h"
#include "core/global/map_snapshot.h"
#include "core/grid/cell_index.h"

namespace gem::evaluation {

struct LoopRule {
  double radius_m = 5;             ///< this near to a place
  double gap_s = 60;               ///< that was passed so long ago
  std::size_t scans_between = 50;  ///< at most one closure in so many scans
};

/// Scans at which SLAM would close a loop, increasing.
std::vector<std::size_t> LoopClosures(const std::vector<Pose<Global, Base>>& poses,
                                      const std::vector<std::int64_t>& stamps_ns,
                                      const LoopRule& rule);

/// A submap and where it lies.
struct LaidSubmap {
  std::shared_ptr<const Submap> submap;
  Pose<Global, Submap> T_G_K;
};

/// Each submap of the run where the map has it. Nothing was merged: a submap that the map does not
/// have is left out.
std::vector<LaidSubmap> LaySubmaps(const SubmapRun& run, const MapSnapshot& map);

/// A cell of G that two passes saw as free.
struct TwicePassed {
  CellIndex cell;
  float first_m = 0;  ///< height at the first pass
  float later_m = 0;  ///< height at a pass at least the gap later, the last one
};

/// Cells of G, in the order of the submaps. gap_s: between the two observations.
std::vector<TwicePassed> PassedTwice(const std::vector<LaidSubmap>& submaps, double cell_size_m,
                                     double gap_s, float traversability_free);

/// Of differences of heights, metres.
struct Deviation {
  std::size_t cells = 0;
  double rms_m = 0;
  double median_m = 0;  ///< of the absolute values, like all that follow
  double p95_m = 0;
};
Deviation DeviationOf(std::vector<double> differences_m);
Deviation DeviationOf(const std::vector<TwicePassed>& cells);

/// Heights of the map's free cells less the true heights; `truth` says nothing where a cell does
/// not count.
Deviation ErrorAgainst(const MapSnapshot& map,
                       const std::function<std::optional<double>(double x_m, double y_m)>& truth);

/// Heights of cells that are free in both, b less a.
Deviation DeviationBetween(const MapSnapshot& a, const MapSnapshot& b);

/// Cells that are not equal in all their values.
std::size_t CellsThatDiffer(const MapSnapshot& a, const MapSnapshot& b);

}  // namespace gem::evaluation
