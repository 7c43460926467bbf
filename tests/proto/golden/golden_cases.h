// What the golden vectors are about: small inputs, put through the encoders of today.
#pragma once

#include "golden.pb.h"

namespace gem::golden {

Grids MakeGrids();
Scans MakeScans();
Refusals MakeRefusals();
Places MakePlaces();

}  // namespace gem::golden
