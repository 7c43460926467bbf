// gem simulate SCENE: streams a simulated robot.
#pragma once

#include <functional>

#include "absl/status/status.h"

namespace CLI {
class App;
}

namespace gem::client {

void AddSimulateCommand(CLI::App& app, std::function<absl::Status()>& run);

}  // namespace gem::client
