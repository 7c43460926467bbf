// gem sessions: lists the sessions of a map, takes what one contributed out of it, and brings it
// back.
#pragma once

#include <functional>

#include "absl/status/status.h"

namespace CLI {
class App;
}

namespace gem::client {

void AddSessionsCommand(CLI::App& app, std::function<absl::Status()>& run);

}  // namespace gem::client
