// gem replay kitti DIR: streams a recorded dataset.
#pragma once

#include <functional>

#include "absl/status/status.h"

namespace CLI {
class App;
}

namespace gem::client {

void AddReplayCommand(CLI::App& app, std::function<absl::Status()>& run);

}  // namespace gem::client
