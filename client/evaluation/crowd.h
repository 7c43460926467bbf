// Fig. 10 in a simulation: people walk among things that stand, about a robot. What is counted of
// it stands in crowd_tally.h.
#pragma once

#include <cstdint>
#include <memory>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/evaluation/experiment.h"
#include "client/simulation/simulated_source.h"

namespace gem::evaluation {

/// 30 people who walk among cubes, posts and walls, about a robot that drives 20 m through them.
absl::StatusOr<std::unique_ptr<SimulatedSource>> MakeCrowd(std::uint64_t seed, int scans_max);

/// Adds the crowd to the report.
absl::Status AddCrowd(const Settings& settings, Report& report);

}  // namespace gem::evaluation
