#include "client/cli/maps_command.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "client/cli/fleet_report.h"
#include "client/cli/json.h"
#include "client/cli/map_files.h"
#include "client/map_client.h"
#include "core/base/status_macros.h"

namespace gem::client {
namespace {

struct MapsFlags {
  std::string server = "127.0.0.1:50051";
  NewMap map;
  std::string file;
  std::string request_id;
  bool force = false;
  bool json = false;
};

MapClient ClientOf(const MapsFlags& flags) {
  return MapClient(std::make_shared<const Connection>(ConnectionOptions{flags.server}));
}

void Print(const MapInfo& map, bool json) {
  std::fputs((json ? MapJson(map) + "\n" : MapsTable({map})).c_str(), stdout);
}

absl::Status List(const MapsFlags& flags) {
  GEM_ASSIGN_OR_RETURN(const std::vector<MapInfo> maps, ClientOf(flags).ListMaps());
  std::fputs(
      (flags.json ? absl::StrCat("{\"maps\":", JsonArray(maps, MapJson), "}\n") : MapsTable(maps))
          .c_str(),
      stdout);
  return absl::OkStatus();
}

absl::Status Show(const MapsFlags& flags) {
  GEM_ASSIGN_OR_RETURN(const MapInfo map, ClientOf(flags).GetMap(flags.map.map));
  Print(map, flags.json);
  return absl::OkStatus();
}

absl::Status Create(const MapsFlags& flags) {
  GEM_ASSIGN_OR_RETURN(const MapInfo map, ClientOf(flags).CreateMap(flags.map, flags.request_id));
  Print(map, flags.json);
  return absl::OkStatus();
}

absl::Status Delete(const MapsFlags& flags) {
  GEM_RETURN_IF_ERROR(ClientOf(flags).DeleteMap(flags.map.map, flags.force, flags.request_id));
  if (flags.json) {
    std::printf("{\"deleted\":%s}\n", JsonText(flags.map.map).c_str());
  } else {
    std::printf("map %s deleted\n", flags.map.map.c_str());
  }
  return absl::OkStatus();
}

absl::Status Export(const MapsFlags& flags) {
  GEM_ASSIGN_OR_RETURN(const std::uint64_t size_bytes,
                       ExportMapFile(ClientOf(flags), flags.map.map, flags.file));
  const auto size = static_cast<unsigned long long>(size_bytes);
  if (flags.json) {
    std::printf("{\"map\":%s,\"file\":%s,\"size_bytes\":%llu}\n", JsonText(flags.map.map).c_str(),
                JsonText(flags.file).c_str(), size);
  } else {
    std::printf("%s: map %s, %llu bytes\n", flags.file.c_str(), flags.map.map.c_str(), size);
  }
  return absl::OkStatus();
}

absl::Status Import(const MapsFlags& flags) {
  GEM_ASSIGN_OR_RETURN(const MapInfo map,
                       ImportMapFile(ClientOf(flags), flags.map.map, flags.file, flags.request_id));
  Print(map, flags.json);
  return absl::OkStatus();
}

/// A command with what all of them take.
CLI::App& Add(CLI::App& maps, const char* name, const char* help,
              const std::shared_ptr<MapsFlags>& flags, absl::Status (*command)(const MapsFlags&),
              std::function<absl::Status()>& run) {
  CLI::App* added = maps.add_subcommand(name, help);
  added->add_option("--server", flags->server, "Address of the server")->capture_default_str();
  added->add_flag("--json", flags->json, "For programs");
  added->callback([flags, command, &run] { run = [flags, command] { return command(*flags); }; });
  return *added;
}

}  // namespace

void AddMapsCommand(CLI::App& app, std::function<absl::Status()>& run) {
  CLI::App* maps = app.add_subcommand("maps", "Make, list, delete, export and import maps");
  maps->require_subcommand(1);
  const auto flags = std::make_shared<MapsFlags>();
  constexpr const char* kRequestId =
      "Sent again with the same id, the command changes nothing (default: a new id)";
  Add(*maps, "list", "All maps", flags, List, run);

  CLI::App& show = Add(*maps, "show", "One map", flags, Show, run);
  show.add_option("--map", flags->map.map, "Map to show")->required();

  CLI::App& create = Add(*maps, "create", "A new, empty map", flags, Create, run);
  create.add_option("--map", flags->map.map, "Id of the map")->required();
  create.add_option("--cell_size_m", flags->map.cell_size_m, "Edge of a cell");
  create.add_option("--submap_length_m", flags->map.submap_length_m, "Path of a submap");
  create.add_flag("--traversable_only", flags->map.traversable_only,
                  "Submaps keep traversable cells only");
  create.add_option("--request_id", flags->request_id, kRequestId);

  CLI::App& remove = Add(*maps, "delete", "Forget a map and its sessions", flags, Delete, run);
  remove.add_option("--map", flags->map.map, "Map to delete")->required();
  remove.add_flag("--force", flags->force, "Also if sessions feed it");
  remove.add_option("--request_id", flags->request_id, kRequestId);

  CLI::App& save = Add(*maps, "export", "Write a map to a file, for import", flags, Export, run);
  save.add_option("--map", flags->map.map, "Map to export")->required();
  save.add_option("--out", flags->file, "File to write, usually NAME.gem")->required();

  CLI::App& load = Add(*maps, "import", "Make a map of such a file", flags, Import, run);
  load.add_option("--map", flags->map.map, "Id of the new map")->required();
  load.add_option("--in", flags->file, "File to read")->required();
  load.add_option("--request_id", flags->request_id, kRequestId);
}

}  // namespace gem::client
