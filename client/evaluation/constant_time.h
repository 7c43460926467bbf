// Fig. 6-8: what a scan costs over a long drive, and what a correction costs as the map grows.
#pragma once

#include <vector>

#include "absl/status/statusor.h"
#include "client/evaluation/experiment.h"

namespace gem::evaluation {

/// Middle one of the values from `begin` on, `count` of them; of an even number the upper middle.
/// 0 of none.
double MedianOf(const std::vector<double>& values, std::size_t begin, std::size_t count);

absl::StatusOr<Report> RunConstantTime(const Settings& settings);

}  // namespace gem::evaluation
