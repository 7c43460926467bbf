// gem correct: sends a corrected trajectory of a session from files.
#pragma once

#include <functional>

#include "absl/status/status.h"

namespace CLI {
class App;
}

namespace gem::client {

void AddCorrectCommand(CLI::App& app, std::function<absl::Status()>& run);

}  // namespace gem::client
