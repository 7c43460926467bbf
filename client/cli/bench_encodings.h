// gem bench encodings: what cells and points take on the wire, on a recording, in this process.
#pragma once

#include <functional>

#include "absl/status/status.h"

namespace CLI {
class App;
}

namespace gem::client {

/// Adds itself to `gem bench`.
void AddBenchEncodingsCommand(CLI::App& bench, std::function<absl::Status()>& run);

}  // namespace gem::client
