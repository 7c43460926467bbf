// gem local: writes the newest robocentric map of a robot to a file.
#pragma once

#include <functional>

#include "absl/status/status.h"

namespace CLI {
class App;
}

namespace gem::client {

void AddLocalCommand(CLI::App& app, std::function<absl::Status()>& run);

}  // namespace gem::client
