// The cells of the cpu backend, layer by layer.
#pragma once

#include <cstdint>
#include <vector>

#include "core/grid/cell_belief.h"
#include "core/local/annotate.h"

namespace gem::cpu {

/// Layers by slot of the ring. A value without its state bit is zero.
struct Layers {
  explicit Layers(std::size_t num_cells)
      : state(num_cells),
        annotated(num_cells),
        elevation_m(num_cells),
        variance_m2(num_cells),
        slope_rad(num_cells),
        roughness_m(num_cells),
        traversability(num_cells),
        rgba(num_cells),
        observed_ns(num_cells) {}

  std::uint8_t StateAt(std::uint32_t slot) const { return state[slot] | annotated[slot]; }
  bool known(std::uint32_t slot) const { return (state[slot] & kCellKnown) != 0; }
  /// Zero where it is not annotated, and the limit is above zero: unknown is never free.
  bool IsFree(std::uint32_t slot, float traversability_free) const {
    return traversability[slot] > traversability_free;
  }
  CellBelief BeliefAt(std::uint32_t slot) const {
    return {elevation_m[slot], variance_m2[slot], traversability[slot],
            rgba[slot],        observed_ns[slot], StateAt(slot)};
  }
  void Forget(std::uint32_t slot) {
    elevation_m[slot] = variance_m2[slot] = 0;
    slope_rad[slot] = roughness_m[slot] = traversability[slot] = 0;
    rgba[slot] = 0;
    observed_ns[slot] = 0;
    state[slot] = annotated[slot] = 0;
  }

  std::vector<std::uint8_t> state;  ///< CellState bits but for the next
  /// 0 or kCellAnnotated. Apart, for while one thread annotates a row, others look at what is
  /// known.
  std::vector<std::uint8_t> annotated;
  std::vector<float> elevation_m;
  std::vector<float> variance_m2;
  std::vector<float> slope_rad;
  std::vector<float> roughness_m;
  std::vector<float> traversability;
  std::vector<Rgba> rgba;
  std::vector<std::int64_t> observed_ns;
};

}  // namespace gem::cpu
