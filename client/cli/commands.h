// All commands of gem.
#pragma once

#include <functional>

#include "absl/status/status.h"

namespace CLI {
class App;
}

namespace gem::client {

/// Parsing sets `run` to what the chosen command will do; that may set exit_code where it has more
/// to say than that it worked. Both outlive the app.
void AddCommands(CLI::App& app, std::function<absl::Status()>& run, int& exit_code);

}  // namespace gem::client
