#include "client/cli/replay_command.h"

#include <CLI/CLI.hpp>
#include <array>
#include <cstdio>
#include <memory>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "client/cli/stream_flags.h"
#include "client/cli/stream_run.h"
#include "client/datasets/kitti_source.h"
#include "client/datasets/kitti_stereo_source.h"
#include "core/base/status_macros.h"

namespace gem::client {
namespace {

// KITTI's car as its velodyne sees it, read off the recordings (-1.25 to 2.57 m, 1.58 m to the
// sides, highest at -0.45 m) with some room. Without it the car is an obstacle at its own place.
constexpr std::array<float, 6> kKittiCar = {-2.0f, -1.6f, -1.8f, 3.0f, 1.6f, -0.3f};

struct ReplayFlags {
  KittiOptions kitti;
  std::string pose_frame = "auto";
  bool stereo = false;
  KittiStereoOptions stereo_options;
  StreamFlags stream;
};

absl::Status ReplayLidar(const ReplayFlags& flags) {
  GEM_ASSIGN_OR_RETURN(const std::unique_ptr<KittiSource> source, KittiSource::Open(flags.kitti));
  GEM_RETURN_IF_ERROR(StreamToServer(*source, flags.stream));
  // Beside the summary for programs, not in it.
  std::FILE* const out = flags.stream.json ? stderr : stdout;
  const auto count = [](std::uint64_t number) { return static_cast<unsigned long long>(number); };
  if (source->num_points_dropped() > 0)
    std::fprintf(out, "%llu points were not finite and were left out\n",
                 count(source->num_points_dropped()));
  if (!flags.kitti.color_images.empty())
    std::fprintf(out, "%llu points were coloured; %llu scans had no image\n",
                 count(source->num_points_colored()), count(source->num_scans_without_image()));
  return absl::OkStatus();
}

absl::Status ReplayStereo(ReplayFlags flags) {
  if (!flags.kitti.color_images.empty())
    return absl::InvalidArgumentError(
        "--color_images is for LiDAR: with --stereo points have the colours of the left image");
  flags.stereo_options.dir = flags.kitti.dir;
  flags.stereo_options.poses = flags.kitti.poses;
  flags.stereo_options.corrected = flags.kitti.corrected;
  flags.stereo_options.pose_frame = flags.kitti.pose_frame;
  if (flags.stream.range_m_max) flags.stereo_options.range_m_max = *flags.stream.range_m_max;
  GEM_ASSIGN_OR_RETURN(const std::unique_ptr<KittiStereoSource> source,
                       KittiStereoSource::Open(flags.stereo_options));
  // The camera sees the ground from six metres on, which the server's window may not reach.
  if (!flags.stream.local_size_m)
    flags.stream.local_size_m = static_cast<float>(2 * flags.stereo_options.range_m_max);
  return StreamToServer(*source, flags.stream);
}

absl::Status ReplayKitti(ReplayFlags flags) {
  GEM_ASSIGN_OR_RETURN(flags.kitti.pose_frame, ParseKittiPoseFrame(flags.pose_frame));
  return flags.stereo ? ReplayStereo(std::move(flags)) : ReplayLidar(flags);
}

}  // namespace

void AddReplayCommand(CLI::App& app, std::function<absl::Status()>& run) {
  CLI::App* replay = app.add_subcommand("replay", "Stream a recorded dataset to a server");
  replay->require_subcommand(1);
  CLI::App* kitti =
      replay->add_subcommand("kitti",
                             "DIR holds velodyne/*.bin, times.txt and pose files, one pose a scan; "
                             "with --stereo pairs of images and calib.txt");
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
  kitti->add_option(
      "--color_images", flags->kitti.color_images,
      "Colour the LiDAR's points from the PNGs of this directory, image_0 to image_3, "
      "with its P and Tr of calib.txt");
  kitti->add_flag("--stereo", flags->stereo,
                  "Stream the stereo camera instead: image_2 and image_3, or image_0 and image_1; "
                  "--range_m_max is 20 and --local_size_m twice that unless given");
  kitti
      ->add_option("--pixel_step", flags->stereo_options.pixel_step,
                   "Stereo: every so many pixels and rows give a point")
      ->capture_default_str();
  kitti
      ->add_option(
          "--num_disparities", flags->stereo_options.matcher.num_disparities,
          "Stereo: largest disparity, pixels, a multiple of 16; nearer things are not found")
      ->capture_default_str();
  flags->stream.body.assign(kKittiCar.begin(), kKittiCar.end());
  AddStreamFlags(*kitti, flags->stream);
  kitti->callback([flags, &run] { run = [flags] { return ReplayKitti(*flags); }; });
}

}  // namespace gem::client
