// gem status: maps, sessions and timings of a server, as a table or as JSON.
#pragma once

#include <functional>

#include "absl/status/status.h"

namespace CLI {
class App;
}

namespace gem::client {

void AddStatusCommand(CLI::App& app, std::function<absl::Status()>& run);

}  // namespace gem::client
