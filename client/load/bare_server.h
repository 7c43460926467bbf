// The least that a gRPC server can do with a robot's stream: reads every message as protobuf, gives
// back its credit, drops it. What gem_server is compared with: the rest is what a map costs.
#pragma once

#include <string>

#include "absl/status/status.h"

namespace gem::load {

/// Prints the line that gem_server prints when it is ready, and serves until SIGINT or SIGTERM.
/// listen: "127.0.0.1:0".
absl::Status RunBareServer(const std::string& listen);

}  // namespace gem::load
