#include "client/cli/local_command.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "client/cli/export_flags.h"
#include "client/cli/grid_export.h"
#include "client/cli/json.h"
#include "client/formats/text_file.h"
#include "client/map_client.h"
#include "core/base/status_macros.h"

namespace gem::client {
namespace {

struct LocalFlags {
  ExportFlags file;
  std::string robot = "robot";
};

absl::Status ExportLocalMap(const LocalFlags& flags) {
  GEM_ASSIGN_OR_RETURN(const Layer layer, ParseLayerFlag(flags.file.layer, LocalMapLayers()));
  GEM_ASSIGN_OR_RETURN(const ExportFormat format, ParseExportFormat(flags.file.format));
  const MapClient client(std::make_shared<const Connection>(ConnectionOptions{flags.file.server}));
  GEM_ASSIGN_OR_RETURN(LocalMap local, client.GetLocalMap(flags.robot, {LayersToRead(layer, format),
                                                                        CellEncoding::kRaw}));
  // The whole window is exported, known or not: its extent is what the robot can see.
  const PlacedGrid placed{std::move(local.grid), local.origin, local.traversability_free};
  GEM_ASSIGN_OR_RETURN(const std::string contents, Export(placed, layer, format));
  GEM_RETURN_IF_ERROR(WriteFileAtomically(flags.file.out, contents));
  const std::vector<std::uint8_t>& valid = placed.grid.Find(layer)->valid;
  const auto num_valid = static_cast<long long>(std::count(valid.begin(), valid.end(), 1));
  if (flags.file.json) {
    std::printf(
        "{\"file\":%s,\"layer\":%s,\"robot\":%s,\"session\":%s,\"seq\":%llu,\"columns\":%d,"
        "\"rows\":%d,\"cell_size_m\":%s,\"num_valid\":%lld}\n",
        JsonText(flags.file.out).c_str(), JsonText(flags.file.layer).c_str(),
        JsonText(flags.robot).c_str(), JsonText(local.session).c_str(),
        static_cast<unsigned long long>(local.seq), placed.grid.columns, placed.grid.rows,
        JsonNumber(placed.grid.cell_size_m).c_str(), num_valid);
    return absl::OkStatus();
  }
  std::printf("%s: %s of robot %s after scan %llu, %d x %d cells of %g m in O, %lld with a value\n",
              flags.file.out.c_str(), flags.file.layer.c_str(), flags.robot.c_str(),
              static_cast<unsigned long long>(local.seq), placed.grid.columns, placed.grid.rows,
              placed.grid.cell_size_m, num_valid);
  return absl::OkStatus();
}

}  // namespace

void AddLocalCommand(CLI::App& app, std::function<absl::Status()>& run) {
  CLI::App* command =
      app.add_subcommand("local", "Write the newest robocentric map of a robot to a file");
  const auto flags = std::make_shared<LocalFlags>();
  AddExportFlags(*command, LocalMapLayers(), flags->file);
  command->add_option("--robot", flags->robot, "Id of the robot")->capture_default_str();
  command->callback([flags, &run] { run = [flags] { return ExportLocalMap(*flags); }; });
}

}  // namespace gem::client
