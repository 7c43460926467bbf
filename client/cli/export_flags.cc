#include "client/cli/export_flags.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <optional>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

namespace gem::client {

namespace {

std::string ListOf(const std::vector<Layer>& layers) {
  return absl::StrJoin(layers, ", ",
                       [](std::string* out, Layer layer) { absl::StrAppend(out, NameOf(layer)); });
}

}  // namespace

std::vector<Layer> GlobalMapLayers() {
  return {Layer::kElevation, Layer::kVariance, Layer::kTraversability, Layer::kColor, Layer::kAge};
}

std::vector<Layer> LocalMapLayers() {
  std::vector<Layer> layers;
  for (std::size_t i = 0; i < kLayerNames.size(); ++i) layers.push_back(static_cast<Layer>(i));
  return layers;
}

void AddExportFlags(CLI::App& command, const std::vector<Layer>& layers, ExportFlags& flags) {
  command.add_option("--server", flags.server, "Address of the server")->capture_default_str();
  command.add_option("--layer", flags.layer, absl::StrCat("What to write: ", ListOf(layers)))
      ->capture_default_str();
  command
      .add_option("--format", flags.format,
                  "asc: ESRI ASCII grid; xyz: one line `x y z` a known cell; png: hillshade with "
                  "colours for traversability, north up; png of color: orthophoto, transparent "
                  "where nothing has a colour")
      ->capture_default_str();
  command.add_option("--out", flags.out, "File to write")->required();
  command.add_flag("--json", flags.json, "What was written, for programs");
}

absl::StatusOr<Layer> ParseLayerFlag(const std::string& name, const std::vector<Layer>& layers) {
  const std::optional<Layer> layer = ParseLayer(name);
  if (layer && std::find(layers.begin(), layers.end(), *layer) != layers.end()) return *layer;
  return absl::InvalidArgumentError(
      absl::StrCat("--layer is \"", name, "\", want one of ", ListOf(layers),
                   layer ? ": tiles have no other, gem local has" : ""));
}

}  // namespace gem::client
