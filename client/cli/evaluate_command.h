// gem evaluate: reruns the experiments of the paper's section VII in this process and writes what
// they found.
#pragma once

#include <functional>

#include "absl/status/status.h"

namespace CLI {
class App;
}

namespace gem::client {

void AddEvaluateCommand(CLI::App& app, std::function<absl::Status()>& run);

}  // namespace gem::client
