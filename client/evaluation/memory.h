// Fig. 17 and 18: what the map occupies over a drive that comes back to its streets.
#pragma once

#include "absl/status/statusor.h"
#include "client/evaluation/experiment.h"

namespace gem::evaluation {

absl::StatusOr<Report> RunMemory(const Settings& settings);

}  // namespace gem::evaluation
