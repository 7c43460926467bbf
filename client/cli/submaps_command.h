// gem submaps: lists the submaps of a map.
#pragma once

#include <functional>

#include "absl/status/status.h"

namespace CLI {
class App;
}

namespace gem::client {

void AddSubmapsCommand(CLI::App& app, std::function<absl::Status()>& run);

}  // namespace gem::client
