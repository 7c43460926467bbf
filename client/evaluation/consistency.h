// Fig. 12 and 14-16: whether streets that are driven twice lie on each other in the map.
#pragma once

#include "absl/status/statusor.h"
#include "client/evaluation/experiment.h"

namespace gem::evaluation {

absl::StatusOr<Report> RunConsistency(const Settings& settings);

}  // namespace gem::evaluation
