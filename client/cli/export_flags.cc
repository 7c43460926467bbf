#include "client/cli/export_flags.h"

#include <CLI/CLI.hpp>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

namespace gem::client {

void AddExportFlags(CLI::App& command, ExportFlags& flags) {
  command.add_option("--server", flags.server, "Address of the server")->capture_default_str();
  command
      .add_option("--layer", flags.layer,
                  absl::StrCat("What to write: ", absl::StrJoin(kLayerNames, ", "),
                               " (slope and roughness: local maps only)"))
      ->capture_default_str();
  command
      .add_option("--format", flags.format,
                  "asc: ESRI ASCII grid; xyz: one line `x y z` a known cell; png: hillshade with "
                  "colours for traversability, north up")
      ->capture_default_str();
  command.add_option("--out", flags.out, "File to write")->required();
}

absl::StatusOr<Layer> ParseLayerFlag(const std::string& name) {
  if (const std::optional<Layer> layer = ParseLayer(name)) return *layer;
  return absl::InvalidArgumentError(
      absl::StrCat("--layer is \"", name, "\", want one of ", absl::StrJoin(kLayerNames, ", ")));
}

}  // namespace gem::client
