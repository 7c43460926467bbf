#include "client/cli/export_command.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "client/cli/export_flags.h"
#include "client/cli/fleet_report.h"
#include "client/cli/grid_export.h"
#include "client/cli/json.h"
#include "client/formats/text_file.h"
#include "client/map_client.h"
#include "core/base/status_macros.h"

namespace gem::client {
namespace {

struct MapExportFlags {
  ExportFlags file;
  std::string map = "default";
  std::vector<double> region;  // empty or four
  int level = 0;
};

absl::Status ExportMap(const MapExportFlags& flags) {
  GEM_ASSIGN_OR_RETURN(const Layer layer, ParseLayerFlag(flags.file.layer, GlobalMapLayers()));
  GEM_ASSIGN_OR_RETURN(const ExportFormat format, ParseExportFormat(flags.file.format));
  std::optional<Region> region;
  if (!flags.region.empty())
    region = Region{flags.region[0], flags.region[1], flags.region[2], flags.region[3]};
  const std::vector<Layer> layers = LayersToRead(layer, format);
  const MapClient client(std::make_shared<const Connection>(ConnectionOptions{flags.file.server}));
  GEM_ASSIGN_OR_RETURN(
      const TiledMap tiled,
      client.ReadMap(flags.map, region, {layers, CellEncoding::kRaw}, flags.level));
  const absl::StatusOr<PlacedGrid> placed = Join(tiled, region, layers);
  if (!placed.ok())
    return absl::Status(placed.status().code(),
                        absl::StrCat("map ", flags.map, ": ", placed.status().message()));
  GEM_ASSIGN_OR_RETURN(const std::string contents, Export(*placed, layer, format));
  GEM_RETURN_IF_ERROR(WriteFileAtomically(flags.file.out, contents));
  if (flags.file.json) {
    std::printf(
        "{\"file\":%s,\"layer\":%s,\"map\":%s,\"columns\":%d,\"rows\":%d,\"cell_size_m\":%s,%s}\n",
        JsonText(flags.file.out).c_str(), JsonText(flags.file.layer).c_str(),
        JsonText(flags.map).c_str(), placed->grid.columns, placed->grid.rows,
        JsonNumber(placed->grid.cell_size_m).c_str(), VersionJson(tiled.matrix.version).c_str());
    return absl::OkStatus();
  }
  std::printf("%s: %s of map %s, %d x %d cells of %g m, version %llu.%llu\n",
              flags.file.out.c_str(), flags.file.layer.c_str(), flags.map.c_str(),
              placed->grid.columns, placed->grid.rows, placed->grid.cell_size_m,
              static_cast<unsigned long long>(tiled.matrix.version.epoch),
              static_cast<unsigned long long>(tiled.matrix.version.revision));
  return absl::OkStatus();
}

}  // namespace

void AddExportCommand(CLI::App& app, std::function<absl::Status()>& run) {
  CLI::App* command = app.add_subcommand(
      "export", "Write a layer of the map to a file, for people and other programs");
  const auto flags = std::make_shared<MapExportFlags>();
  AddExportFlags(*command, GlobalMapLayers(), flags->file);
  command->add_option("--map", flags->map, "Map to export")->capture_default_str();
  command
      ->add_option("--region", flags->region,
                   "X0,Y0,X1,Y1: only cells with centres in it, metres of G")
      ->delimiter(',')
      ->expected(4);
  command
      ->add_option("--level", flags->level,
                   "Of the pyramid: each level halves the resolution, obstacles stay")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  command->callback([flags, &run] { run = [flags] { return ExportMap(*flags); }; });
}

}  // namespace gem::client
