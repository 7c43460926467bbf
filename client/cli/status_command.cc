#include "client/cli/status_command.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "client/cli/status_report.h"
#include "client/map_client.h"
#include "core/base/status_macros.h"

namespace gem::client {
namespace {

struct StatusFlags {
  std::string server = "127.0.0.1:50051";
  bool json = false;
};

absl::Status PrintStatus(const StatusFlags& flags) {
  const MapClient client(std::make_shared<const Connection>(ConnectionOptions{flags.server}));
  GEM_ASSIGN_OR_RETURN(const ServerStatus status, client.GetServerStatus());
  GEM_ASSIGN_OR_RETURN(const std::vector<MapInfo> maps, client.ListMaps());
  std::fputs((flags.json ? StatusJson(status, maps) : StatusTable(status, maps)).c_str(), stdout);
  return absl::OkStatus();
}

}  // namespace

void AddStatusCommand(CLI::App& app, std::function<absl::Status()>& run) {
  CLI::App* command = app.add_subcommand("status", "Maps, sessions and timings of a server");
  const auto flags = std::make_shared<StatusFlags>();
  command->add_option("--server", flags->server, "Address of the server")->capture_default_str();
  command->add_flag("--json", flags->json, "For programs");
  command->callback([flags, &run] { run = [flags] { return PrintStatus(*flags); }; });
}

}  // namespace gem::client
