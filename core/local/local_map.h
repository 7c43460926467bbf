// A robocentric map that does not change any more: what readers get. Frame O.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/geometry/pose.h"
#include "core/grid/cell_belief.h"

namespace gem {

/// Layers by rows from the lower left: index = row * side_cells + column. A value means something
/// only where its CellState bit is set; elsewhere it is zero.
struct LocalMap {
  std::int64_t stamp_ns = 0;  ///< of the newest fused scan
  std::uint64_t seq = 0;      ///< of the newest fused scan
  Pose<Odom, Base> T_O_B;     ///< at the stamp
  CellIndex origin;           ///< cell of O at column 0, row 0
  std::int32_t side_cells = 0;
  float cell_size_m = 0;
  float traversability_free = 0;  ///< cells above this are free

  std::vector<std::uint8_t> state;  ///< CellState bits
  std::vector<float> elevation_m;   ///< in O
  std::vector<float> variance_m2;
  std::vector<float> slope_rad;
  std::vector<float> roughness_m;
  std::vector<float> traversability;
  std::vector<Rgba> rgba;
  std::vector<std::int64_t> observed_ns;  ///< last observation

  std::size_t num_cells() const { return state.size(); }
  CellRect rect() const { return {origin, {origin.x + side_cells, origin.y + side_cells}}; }
  /// cell must lie in rect().
  std::size_t IndexOf(CellIndex cell) const {
    return static_cast<std::size_t>(cell.y - origin.y) * static_cast<std::size_t>(side_cells) +
           static_cast<std::size_t>(cell.x - origin.x);
  }
  void ResizeLayers(std::size_t num_cells) {
    state.resize(num_cells);
    elevation_m.resize(num_cells);
    variance_m2.resize(num_cells);
    slope_rad.resize(num_cells);
    roughness_m.resize(num_cells);
    traversability.resize(num_cells);
    rgba.resize(num_cells);
    observed_ns.resize(num_cells);
  }
  CellBelief BeliefAt(std::size_t index) const {
    return {elevation_m[index], variance_m2[index], traversability[index],
            rgba[index],        observed_ns[index], state[index]};
  }
};

}  // namespace gem
