#include "client/datasets/kitti_source.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <optional>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "client/camera/project_colors.h"
#include "client/formats/png_file.h"
#include "client/formats/text_file.h"
#include "core/base/status_macros.h"

namespace gem {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kPointBytes = 16;                          // float32 x, y, z, intensity
constexpr std::uint64_t kScanBytesMax = std::uint64_t{1} << 30;  // 67 million points

/// Decides whether poses are the camera's; if so, Tr is what turns them into the velodyne's.
absl::StatusOr<std::optional<Pose<Camera0, Base>>> CameraFromVelodyne(
    const KittiOptions& options, const std::string& poses_path) {
  const bool automatic = options.pose_frame == KittiPoseFrame::kAutomatic;
  if (options.pose_frame == KittiPoseFrame::kVelodyne ||
      (automatic && fs::path(poses_path).filename() != "poses.txt"))
    return std::optional<Pose<Camera0, Base>>();
  const std::string path = InDirectory(options.dir, "calib.txt");
  GEM_ASSIGN_OR_RETURN(const auto Tr, ReadTr(path));
  if (!Tr && !automatic)
    return absl::NotFoundError(
        absl::StrCat(path, ": no line \"Tr:\", which poses of the camera need"));
  return Tr;
}

/// One pose a scan, of the velodyne.
absl::StatusOr<std::vector<RigidTransform>> ReadVelodynePoses(
    const std::string& path, const std::optional<Pose<Camera0, Base>>& Tr, const TimesFile& times) {
  GEM_ASSIGN_OR_RETURN(PoseFile file, ReadBasePoses(path, Tr));
  GEM_RETURN_IF_ERROR(CheckSameCount(file, times));
  return std::move(file.poses);
}

std::string ImageOf(const std::string& images_dir, const std::string& scan_path) {
  return InDirectory(images_dir, fs::path(scan_path).stem().string() + ".png");
}

}  // namespace

absl::StatusOr<std::unique_ptr<KittiSource>> KittiSource::Open(const KittiOptions& options) {
  std::unique_ptr<KittiSource> source(new KittiSource());
  source->name_ = DirectoryName(options.dir);
  GEM_ASSIGN_OR_RETURN(source->noise_, MakeNoiseModel(LidarNoise{}));

  const std::string scans_dir = InDirectory(options.dir, "velodyne");
  GEM_ASSIGN_OR_RETURN(source->scan_paths_, ListFiles(scans_dir, "", ".bin"));
  if (source->scan_paths_.empty())
    return absl::NotFoundError(absl::StrCat(scans_dir, ": no *.bin file"));

  GEM_ASSIGN_OR_RETURN(TimesFile times, ReadTimesFile(InDirectory(options.dir, "times.txt")));
  if (times.stamps_ns.size() != source->scan_paths_.size())
    return absl::InvalidArgumentError(absl::StrCat(times.path, " has ", times.stamps_ns.size(),
                                                   " times, but ", scans_dir, " has ",
                                                   source->scan_paths_.size(), " scans"));
  GEM_ASSIGN_OR_RETURN(const std::string poses_path, FindPosesFile(options.dir, options.poses));
  GEM_ASSIGN_OR_RETURN(const auto Tr, CameraFromVelodyne(options, poses_path));
  GEM_ASSIGN_OR_RETURN(source->poses_, ReadVelodynePoses(poses_path, Tr, times));
  if (!options.corrected.empty()) {
    GEM_ASSIGN_OR_RETURN(source->corrected_,
                         ReadVelodynePoses(InDirectory(options.dir, options.corrected), Tr, times));
  }
  if (!options.color_images.empty()) {
    GEM_ASSIGN_OR_RETURN(source->color_camera_, OpenColorCamera(options, source->scan_paths_));
  }
  source->stamps_ns_ = std::move(times.stamps_ns);
  return source;
}

absl::StatusOr<KittiSource::ColorCamera> KittiSource::OpenColorCamera(
    const KittiOptions& options, const std::vector<std::string>& scan_paths) {
  const std::string dir = InDirectory(options.dir, options.color_images);
  const std::string name = DirectoryName(dir);
  if (name.size() != 7 || !absl::StartsWith(name, "image_") || name[6] < '0' || name[6] > '3')
    return absl::InvalidArgumentError(
        absl::StrCat(dir, ": want a directory called image_0 to image_3, a camera of calib.txt"));
  if (std::none_of(scan_paths.begin(), scan_paths.end(), [&dir](const std::string& scan) {
        std::error_code error;
        return fs::exists(ImageOf(dir, scan), error);
      }))
    return absl::NotFoundError(
        absl::StrCat(dir, ": no image of any scan, such as ",
                     fs::path(ImageOf(dir, scan_paths.front())).filename().string()));
  const std::string calibration = InDirectory(options.dir, "calib.txt");
  GEM_ASSIGN_OR_RETURN(const KittiCamera camera, ReadKittiCamera(calibration, name[6] - '0'));
  GEM_ASSIGN_OR_RETURN(const auto T_C0_B, ReadTr(calibration));
  if (!T_C0_B)
    return absl::NotFoundError(
        absl::StrCat(calibration, ": no line \"Tr:\", which colours of a camera need"));
  const Pose<Base, Sensor> T_B_S;  // the base is the velodyne
  return ColorCamera{dir, camera.model, camera.T_C_C0 * *T_C0_B * T_B_S};
}

absl::Status KittiSource::ReadPoints(const std::string& path, std::vector<ScanPoint>& points) {
  GEM_ASSIGN_OR_RETURN(const std::string bytes, ReadFile(path, kScanBytesMax));
  if (bytes.size() % kPointBytes != 0)
    return absl::InvalidArgumentError(absl::StrCat(
        path, ": ", bytes.size(), " bytes, want a multiple of ", kPointBytes,
        ": the file ends within the point at offset ", bytes.size() / kPointBytes * kPointBytes));
  points.clear();
  points.reserve(bytes.size() / kPointBytes);
  for (std::size_t offset = 0; offset < bytes.size(); offset += kPointBytes) {
    float xyz[3];
    std::memcpy(xyz, bytes.data() + offset, sizeof(xyz));
    if (std::isfinite(xyz[0]) && std::isfinite(xyz[1]) && std::isfinite(xyz[2])) {
      points.push_back({xyz[0], xyz[1], xyz[2], 0});
    } else {
      ++num_points_dropped_;
    }
  }
  return absl::OkStatus();
}

absl::Status KittiSource::ColorPoints(const std::string& scan_path,
                                      std::vector<ScanPoint>& points) {
  const std::string image_path = ImageOf(color_camera_->dir, scan_path);
  std::error_code error;
  if (!fs::exists(image_path, error)) {
    ++num_scans_without_image_;
    return absl::OkStatus();
  }
  GEM_ASSIGN_OR_RETURN(const Image image, ReadPng(image_path));
  num_points_colored_ += ProjectColors(points, image, color_camera_->model, color_camera_->T_C_S);
  return absl::OkStatus();
}

absl::StatusOr<bool> KittiSource::Next(SourceScan& scan) {
  if (next_ == scan_paths_.size()) return false;
  GEM_RETURN_IF_ERROR(ReadPoints(scan_paths_[next_], scan.points));
  if (color_camera_) GEM_RETURN_IF_ERROR(ColorPoints(scan_paths_[next_], scan.points));
  scan.stamp_ns = stamps_ns_[next_];
  scan.T_O_B = poses_[next_].As<Odom, Base>();
  scan.T_G_B.reset();
  if (!corrected_.empty()) scan.T_G_B = corrected_[next_].As<Global, Base>();
  ++next_;
  return true;
}

}  // namespace gem
