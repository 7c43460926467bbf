#include "client/cli/sessions_command.h"

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

struct SessionsFlags {
  std::string server = "127.0.0.1:50051";
  std::string map = "default";
  std::string session;
  std::string request_id;
  bool json = false;
};

MapClient ClientOf(const SessionsFlags& flags) {
  return MapClient(std::make_shared<const Connection>(ConnectionOptions{flags.server}));
}

absl::Status List(const SessionsFlags& flags) {
  GEM_ASSIGN_OR_RETURN(const std::vector<SessionInfo> sessions,
                       ClientOf(flags).ListSessions(flags.map));
  std::fputs((flags.json ? SessionsJson(flags.map, sessions) : SessionsTable(sessions)).c_str(),
             stdout);
  return absl::OkStatus();
}

absl::Status Change(const SessionsFlags& flags, bool restore) {
  GEM_ASSIGN_OR_RETURN(
      const RetractionResult result,
      ClientOf(flags).RetractSession(flags.map, flags.session, restore, flags.request_id));
  const auto points = static_cast<unsigned long long>(result.num_merged_points);
  if (flags.json) {
    std::printf("{%s,\"num_submaps\":%u,\"num_merged_points\":%llu,\"num_touched_tiles\":%u}\n",
                VersionJson(result.version).c_str(), result.num_submaps, points,
                result.num_touched_tiles);
  } else {
    std::printf("%s %u submaps and %llu merged points; %u tiles; version %llu.%llu\n",
                restore ? "restored" : "retracted", result.num_submaps, points,
                result.num_touched_tiles, static_cast<unsigned long long>(result.version.epoch),
                static_cast<unsigned long long>(result.version.revision));
  }
  return absl::OkStatus();
}

absl::Status Retract(const SessionsFlags& flags) { return Change(flags, false); }
absl::Status Restore(const SessionsFlags& flags) { return Change(flags, true); }

}  // namespace

void AddSessionsCommand(CLI::App& app, std::function<absl::Status()>& run) {
  CLI::App* sessions =
      app.add_subcommand("sessions", "List the sessions of a map, retract and restore them");
  sessions->require_subcommand(1);
  const auto flags = std::make_shared<SessionsFlags>();
  const auto add = [&](const char* name, const char* help,
                       absl::Status (*command)(const SessionsFlags&)) {
    CLI::App* added = sessions->add_subcommand(name, help);
    added->add_option("--server", flags->server, "Address of the server")->capture_default_str();
    added->add_option("--map", flags->map, "Map of the sessions")->capture_default_str();
    added->add_flag("--json", flags->json, "For programs");
    added->callback([flags, command, &run] { run = [flags, command] { return command(*flags); }; });
    return added;
  };
  add("list", "All sessions that ever fed a map", List);
  for (CLI::App* change :
       {add("retract", "Take what a session contributed out of the map", Retract),
        add("restore", "Bring it back", Restore)}) {
    change->add_option("--session", flags->session, "Id of the session")->required();
    change->add_option("--request_id", flags->request_id,
                       "Sent again with the same id, the command changes nothing (default: a new "
                       "id)");
  }
}

}  // namespace gem::client
