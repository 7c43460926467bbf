// The options that `gem export` and `gem local` share: what of a map goes to which file.
#pragma once

#include <string>
#include <vector>

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
  bool json = false;
};

/// The layers that a command can write, as they are typed.
std::vector<Layer> GlobalMapLayers();  ///< all but slope and roughness
std::vector<Layer> LocalMapLayers();   ///< all

void AddExportFlags(CLI::App& command, const std::vector<Layer>& layers, ExportFlags& flags);

/// INVALID_ARGUMENT lists `layers` as they are typed.
absl::StatusOr<Layer> ParseLayerFlag(const std::string& name, const std::vector<Layer>& layers);

}  // namespace gem::client
