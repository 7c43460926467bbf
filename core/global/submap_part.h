// A square piece of a submap, for the purpose of moving it: where its cells are, when they were
// last seen and how many there are.
#pragma once

#include <cstdint>

#include "core/geometry/pose.h"

namespace gem {

struct SubmapPart {
  Point<Submap> middle;  ///< mean of its cells
  double spread_m2 = 0;  ///< mean square of its cells' distance from the middle, along an axis
  double num_cells = 0;
  std::int64_t stamp_ns = 0;  ///< mean of its cells' last observations
};

}  // namespace gem
