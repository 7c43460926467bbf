// gem sample and gem check-path: questions about the ground of a map.
#pragma once

#include <functional>

#include "absl/status/status.h"

namespace CLI {
class App;
}

namespace gem::client {

void AddSampleCommand(CLI::App& app, std::function<absl::Status()>& run);
/// `exit_code` becomes 1 if the path is not free, 2 if that could not be found out.
void AddCheckPathCommand(CLI::App& app, std::function<absl::Status()>& run, int& exit_code);

}  // namespace gem::client
