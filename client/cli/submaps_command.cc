#include "client/cli/submaps_command.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "client/cli/fleet_report.h"
#include "client/map_client.h"
#include "core/base/status_macros.h"

namespace gem::client {
namespace {

struct SubmapsFlags {
  std::string server = "127.0.0.1:50051";
  std::string map = "default";
  bool json = false;
};

absl::Status List(const SubmapsFlags& flags) {
  const MapClient client(std::make_shared<const Connection>(ConnectionOptions{flags.server}));
  GEM_ASSIGN_OR_RETURN(const std::vector<SubmapInfo> submaps, client.ListSubmaps(flags.map));
  std::fputs((flags.json ? SubmapsJson(flags.map, submaps) : SubmapsTable(submaps)).c_str(),
             stdout);
  return absl::OkStatus();
}

}  // namespace

void AddSubmapsCommand(CLI::App& app, std::function<absl::Status()>& run) {
  CLI::App* submaps = app.add_subcommand("submaps", "See what a map consists of");
  submaps->require_subcommand(1);
  CLI::App* list = submaps->add_subcommand("list", "All submaps of a map");
  const auto flags = std::make_shared<SubmapsFlags>();
  list->add_option("--server", flags->server, "Address of the server")->capture_default_str();
  list->add_option("--map", flags->map, "Map of the submaps")->capture_default_str();
  list->add_flag("--json", flags->json, "For programs");
  list->callback([flags, &run] { run = [flags] { return List(*flags); }; });
}

}  // namespace gem::client
