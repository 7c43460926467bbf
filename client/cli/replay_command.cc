#include "client/cli/replay_command.h"

#include <CLI/CLI.hpp>
#include <array>
#include <cstdio>
#include <memory>
#include <string>

#include "client/cli/stream_flags.h"
#include "client/cli/stream_run.h"
#include "client/datasets/kitti_source.h"
#include "core/base/status_macros.h"

namespace gem::client {
namespace {

// KITTI's car as its velodyne sees it, read off the recordings (-1.25 to 2.57 m, 1.58 m to the
// sides, highest at -0.45 m) with some room. Without it the car is an obstacle at its own place.
constexpr std::array<float, 6> kKittiCar = {-2.0f, -1.6f, -1.8f, 3.0f, 1.6f, -0.3f};

struct ReplayFlags {
  KittiOptions kitti;
  std::string pose_frame = "auto";
  StreamFlags stream;
};

absl::Status ReplayKitti(ReplayFlags flags) {
  GEM_ASSIGN_OR_RETURN(flags.kitti.pose_frame, ParseKittiPoseFrame(flags.pose_frame));
  GEM_ASSIGN_OR_RETURN(const std::unique_ptr<KittiSource> source, KittiSource::Open(flags.kitti));
  GEM_RETURN_IF_ERROR(StreamToServer(*source, flags.stream));
  if (source->num_points_dropped() > 0)
    std::printf("%llu points were not finite and were left out\n",
                static_cast<unsigned long long>(source->num_points_dropped()));
  return absl::OkStatus();
}

}  // namespace

void AddReplayCommand(CLI::App& app, std::function<absl::Status()>& run) {
  CLI::App* replay = app.add_subcommand("replay", "Stream a recorded dataset to a server");
  replay->require_subcommand(1);
  CLI::App* kitti = replay->add_subcommand(
      "kitti", "DIR holds velodyne/*.bin, times.txt and pose files, one pose a scan");
  const auto flags = std::make_shared<ReplayFlags>();
  kitti->add_option("DIR", flags->kitti.dir, "Directory of the recording")->required();
  kitti->add_option("--poses", flags->kitti.poses,
                    "Odometry, relative to DIR (default: poses.txt, or the only poses*.txt)");
  kitti->add_option("--corrected", flags->kitti.corrected,
                    "SLAM's corrected poses, relative to DIR; sent when --correct_at says so");
  kitti
      ->add_option("--pose_frame", flags->pose_frame,
                   "What the poses are of: velodyne, camera (camera 0, turned by Tr of calib.txt), "
                   "or auto: camera if the poses file is poses.txt and calib.txt has a Tr")
      ->capture_default_str();
  flags->stream.body.assign(kKittiCar.begin(), kKittiCar.end());
  AddStreamFlags(*kitti, flags->stream);
  kitti->callback([flags, &run] { run = [flags] { return ReplayKitti(*flags); }; });
}

}  // namespace gem::client
