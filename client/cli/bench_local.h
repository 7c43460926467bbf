// gem bench local: times the local mapper in this process over a recorded KITTI directory, stage by
// stage, against the time it takes to read every point once.
#pragma once

#include <functional>
#include <string>

#include "absl/status/status.h"
#include "client/evaluation/local_bench.h"

namespace CLI {
class App;
}

namespace gem::client {

std::string BenchJson(const evaluation::LocalBench& bench);
std::string BenchTable(const evaluation::LocalBench& bench);

void AddBenchCommand(CLI::App& app, std::function<absl::Status()>& run);

}  // namespace gem::client
