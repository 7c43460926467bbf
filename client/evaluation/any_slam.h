// One server, unchanged, under three SLAM systems (the paper's section III: any SLAM system whose
// poses are given can be used).
#pragma once

#include "absl/status/statusor.h"
#include "client/evaluation/experiment.h"

namespace gem::evaluation {

absl::StatusOr<Report> RunAnySlam(const Settings& settings);

}  // namespace gem::evaluation
