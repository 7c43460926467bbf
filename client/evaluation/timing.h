// Table II: what a scan costs the local mapper, stage by stage.
#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <vector>

#include "absl/status/statusor.h"
#include "client/evaluation/experiment.h"
#include "client/evaluation/local_bench.h"

namespace gem::evaluation {

/// Medians of a run under the names of Table II, milliseconds.
struct PaperSteps_ms {
  double build = 0;     ///< "geometric map building": move, measure, fuse
  double annotate = 0;  ///< "traversability annotation"
  double clear = 0;     ///< "dynamic objects process"
  double total = 0;     ///< median of the totals, not the sum of the medians
};
PaperSteps_ms PaperStepsOf(const LocalBench& bench);

/// Opens the same scans anew.
using OpenSource = std::function<absl::StatusOr<std::unique_ptr<ScanSource>>()>;

/// Each scan at its quickest of several runs: the work is the same each time, but other programs
/// take the processor away now and then. num_runs >= 1.
absl::StatusOr<std::vector<ScanTiming>> TimeScansAtBest(const OpenSource& open,
                                                        LocalBackend backend,
                                                        const LocalMapOptions& options,
                                                        std::size_t num_scans_max, int num_runs);

absl::StatusOr<Report> RunTiming(const Settings& settings);

}  // namespace gem::evaluation
