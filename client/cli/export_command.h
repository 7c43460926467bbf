// gem export: writes the global map, or a region of it, to a file.
#pragma once

#include <functional>

#include "absl/status/status.h"

namespace CLI {
class App;
}

namespace gem::client {

void AddExportCommand(CLI::App& app, std::function<absl::Status()>& run);

}  // namespace gem::client
