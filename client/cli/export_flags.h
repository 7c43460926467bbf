// The options that `gem export` and `gem local` share: what of a map goes to which file.
#pragma once

#include <string>

#include "absl/status/statusor.h"
#include "core/grid/layered_grid.h"

namespace CLI {
class App;
}

namespace gem::client {

/// As typed.
struct ExportFlags {
  std::string server = "127.0.0.1:50051";
  std::string layer = "elevation";
  std::string format = "asc";
  std::string out;
};

void AddExportFlags(CLI::App& command, ExportFlags& flags);

/// INVALID_ARGUMENT lists the layers there are.
absl::StatusOr<Layer> ParseLayerFlag(const std::string& name);

}  // namespace gem::client
