// gem watch: keeps a region of a map up to date and prints one line a version.
#pragma once

#include <functional>

#include "absl/status/status.h"

namespace CLI {
class App;
}

namespace gem::client {

void AddWatchCommand(CLI::App& app, std::function<absl::Status()>& run);

}  // namespace gem::client
