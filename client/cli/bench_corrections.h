// gem bench corrections: corrects a large map many times a second while its robot streams, through
// a gem_server of its own.
#pragma once

#include <functional>

#include "absl/status/status.h"

namespace CLI {
class App;
}

namespace gem::client {

/// Adds itself to `gem bench`.
void AddBenchCorrectionsCommand(CLI::App& bench, std::function<absl::Status()>& run);

}  // namespace gem::client
