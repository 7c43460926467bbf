// Figs. 10 and 13: what moves is forgotten, in the local map at once and in the global map when the
// place is mapped again.
#pragma once

#include "absl/status/statusor.h"
#include "client/evaluation/experiment.h"

namespace gem::evaluation {

absl::StatusOr<Report> RunDynamics(const Settings& settings);

}  // namespace gem::evaluation
