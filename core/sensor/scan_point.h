// A measured point, as sensors give it and as every backend of the local mapper takes it. Its own
// header, so that device code need not see matrices.
#pragma once

#include "core/grid/cell_belief.h"

namespace gem {

/// A measured point in S, metres; finite. 16 bytes, so that four floats load at once.
struct ScanPoint {
  float x_m = 0;
  float y_m = 0;
  float z_m = 0;
  Rgba rgba = 0;
};

}  // namespace gem
