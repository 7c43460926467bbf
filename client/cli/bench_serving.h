// `gem bench serving`: what a server serves on this machine, as a table or JSON.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "client/load/serving_bench.h"

namespace CLI {
class App;
}

namespace gem::client {

/// bench: the app of `gem bench`.
void AddBenchServingCommand(CLI::App& bench, std::function<absl::Status()>& run);

/// What was measured; parts that were not asked for are empty.
struct ServingReport {
  std::string scans;  ///< their name
  double points_per_scan = 0;
  std::vector<load::IngestResult> ingest;
  std::vector<load::ReadingBench> reading;  ///< one or none
  std::vector<load::WatchResult> watching;
};

std::string ServingTable(const ServingReport& report);
std::string ServingJson(const ServingReport& report);

}  // namespace gem::client
