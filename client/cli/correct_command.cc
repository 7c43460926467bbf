#include "client/cli/correct_command.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <string>

#include "client/cli/fleet_report.h"
#include "client/datasets/pose_file.h"
#include "client/map_client.h"
#include "core/base/status_macros.h"

namespace gem::client {
namespace {

struct CorrectFlags {
  std::string server = "127.0.0.1:50051";
  std::string map = "default";
  std::string session;
  std::string poses;
  std::string times;
  bool json = false;
};

absl::Status Correct(const CorrectFlags& flags) {
  auto poses = ReadStampedPoses<Global, Base>(flags.poses, flags.times);
  if (!poses.ok()) return poses.status();
  const MapClient client(std::make_shared<const Connection>(ConnectionOptions{flags.server}));
  GEM_ASSIGN_OR_RETURN(const CorrectionResult result,
                       client.CorrectTrajectory({flags.map, flags.session, "", *std::move(poses)}));
  if (flags.json) {
    std::printf(
        "{%s,\"num_moved_submaps\":%u,\"num_touched_tiles\":%u,\"num_poses_ahead\":%u,"
        "\"num_poses_ignored\":%u}\n",
        VersionJson(result.version).c_str(), result.num_moved_submaps, result.num_touched_tiles,
        result.num_poses_ahead, result.num_poses_ignored);
    return absl::OkStatus();
  }
  std::printf("moved %u submaps and %u tiles; %u poses ahead, %u ignored; version %llu.%llu\n",
              result.num_moved_submaps, result.num_touched_tiles, result.num_poses_ahead,
              result.num_poses_ignored, static_cast<unsigned long long>(result.version.epoch),
              static_cast<unsigned long long>(result.version.revision));
  return absl::OkStatus();
}

}  // namespace

void AddCorrectCommand(CLI::App& app, std::function<absl::Status()>& run) {
  CLI::App* command =
      app.add_subcommand("correct", "Send SLAM's corrected trajectory of a session");
  const auto flags = std::make_shared<CorrectFlags>();
  command->add_option("--server", flags->server, "Address of the server")->capture_default_str();
  command->add_option("--map", flags->map, "Map of the session")->capture_default_str();
  command->add_option("--session", flags->session, "Session to correct")->required();
  command->add_option("--poses", flags->poses, "T_G_B, twelve numbers [R | t] a line")->required();
  command->add_option("--times", flags->times, "Time of each pose, seconds, one a line")
      ->required();
  command->add_flag("--json", flags->json, "For programs");
  command->callback([flags, &run] { run = [flags] { return Correct(*flags); }; });
}

}  // namespace gem::client
