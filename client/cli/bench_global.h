// gem bench global: times corrections and composing on a made-up map, in this process.
#pragma once

#include <functional>

#include "absl/status/status.h"

namespace CLI {
class App;
}

namespace gem::client {

/// Adds itself to `gem bench`.
void AddBenchGlobalCommand(CLI::App& bench, std::function<absl::Status()>& run);

}  // namespace gem::client
