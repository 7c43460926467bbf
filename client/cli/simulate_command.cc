#include "client/cli/simulate_command.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <memory>
#include <string>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/cli/stream_flags.h"
#include "client/cli/stream_run.h"
#include "client/formats/text_file.h"
#include "client/simulation/scenes.h"
#include "core/base/status_macros.h"

namespace gem::client {
namespace {

constexpr std::size_t kScansMax = 1'000'000;

struct SimulateFlags {
  SceneOptions scene;
  StreamFlags stream;
  std::string save_corrected;
  std::string save_times;
};

std::string SceneHelp() {
  std::string text = "World and robot, one of:";
  for (const SceneInfo& scene : SceneList())
    absl::StrAppend(&text, "\n  ", scene.name, ": ", scene.description);
  return text;
}

/// Files for `gem correct`: twelve numbers [R | t] a line, and one time a line.
absl::Status SaveTruth(const SimulatedSource& source, const SimulateFlags& flags) {
  std::string poses;
  std::string times;
  for (const SimulatedPose& pose : source.poses()) {
    const Eigen::Matrix3d rotation = pose.T_G_B.matrix();
    const Eigen::Vector3d& translation = pose.T_G_B.translation();
    for (int row = 0; row < 3; ++row) {
      absl::StrAppendFormat(&poses, "%.12g %.12g %.12g %.12g%c", rotation(row, 0), rotation(row, 1),
                            rotation(row, 2), translation(row), row == 2 ? '\n' : ' ');
    }
    absl::StrAppendFormat(&times, "%d.%09d\n", pose.stamp_ns / 1'000'000'000,
                          pose.stamp_ns % 1'000'000'000);
  }
  if (!flags.save_corrected.empty())
    GEM_RETURN_IF_ERROR(WriteFileAtomically(flags.save_corrected, poses));
  if (flags.save_times.empty()) return absl::OkStatus();
  return WriteFileAtomically(flags.save_times, times);
}

absl::Status Simulate(SimulateFlags flags) {
  if (flags.stream.scans)
    flags.scene.scans_max = static_cast<int>(std::min(*flags.stream.scans, kScansMax));
  GEM_ASSIGN_OR_RETURN(const std::unique_ptr<SimulatedSource> source, MakeScene(flags.scene));
  GEM_RETURN_IF_ERROR(SaveTruth(*source, flags));
  return StreamToServer(*source, flags.stream);
}

}  // namespace

void AddSimulateCommand(CLI::App& app, std::function<absl::Status()>& run) {
  CLI::App* command = app.add_subcommand("simulate", "Stream a simulated robot to a server");
  const auto flags = std::make_shared<SimulateFlags>();
  command->add_option("SCENE", flags->scene.name, SceneHelp())->required();
  command->add_option("--seed", flags->scene.seed, "Same seed, same scans")->capture_default_str();
  command->add_option("--rings", flags->scene.rings, "Rings of the LiDAR")->capture_default_str();
  command->add_option("--azimuths", flags->scene.azimuths, "Beams of a ring in one turn")
      ->capture_default_str();
  command->add_option("--scan_spacing_m", flags->scene.scan_spacing_m,
                      "Path from one scan to the next (default: the scene's own)");
  command
      ->add_option("--drift", flags->scene.drift_scale,
                   "Factor on the drift of the odometry; 0: odometry is the truth")
      ->capture_default_str();
  command
      ->add_option("--noise", flags->scene.noise_scale,
                   "Factor on the noise of ranges and on the share of lost beams")
      ->capture_default_str();
  command->add_option("--terrain", flags->scene.terrain_file,
                      "ESRI ASCII grid for the scene terrain");
  command->add_option("--save_corrected", flags->save_corrected,
                      "Write the true poses of all scans to this file, for `gem correct --poses`");
  command->add_option("--save_times", flags->save_times,
                      "Write the times of all scans to this file, for `gem correct --times`");
  AddStreamFlags(*command, flags->stream);
  command->callback([flags, &run] { run = [flags] { return Simulate(*flags); }; });
}

}  // namespace gem::client
