// `gem bench soak`: minutes of everything at once; fails if the server grows.
#pragma once

#include <functional>
#include <string>

#include "absl/status/status.h"
#include "client/load/soak.h"

namespace CLI {
class App;
}

namespace gem::client {

/// bench: the app of `gem bench`.
void AddBenchSoakCommand(CLI::App& bench, std::function<absl::Status()>& run);

std::string SoakTable(const load::SoakReport& report);
std::string SoakJson(const load::SoakReport& report);

}  // namespace gem::client
