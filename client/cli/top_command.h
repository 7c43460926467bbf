// `gem top`: what a server is doing, again and again.
#pragma once

#include <functional>

#include "absl/status/status.h"

namespace CLI {
class App;
}

namespace gem::client {

void AddTopCommand(CLI::App& app, std::function<absl::Status()>& run);

}  // namespace gem::client
