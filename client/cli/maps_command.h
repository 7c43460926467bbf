// gem maps: makes, lists, deletes, exports and imports maps.
#pragma once

#include <functional>

#include "absl/status/status.h"

namespace CLI {
class App;
}

namespace gem::client {

void AddMapsCommand(CLI::App& app, std::function<absl::Status()>& run);

}  // namespace gem::client
