#include "client/datasets/kitti_source.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <optional>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "client/formats/text_file.h"
#include "core/base/status_macros.h"

namespace gem {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kPointBytes = 16;                          // float32 x, y, z, intensity
constexpr std::uint64_t kScanBytesMax = std::uint64_t{1} << 30;  // 67 million points
constexpr std::uint64_t kCalibrationBytesMax = 1 << 20;

/// Paths of the files of `dir` that `wanted` takes, by name.
template <typename Predicate>
absl::StatusOr<std::vector<std::string>> ListFiles(const std::string& dir, Predicate wanted) {
  std::error_code error;
  std::vector<std::string> paths;
  fs::directory_iterator entry(dir, error);
  for (; !error && entry != fs::directory_iterator(); entry.increment(error))
    if (wanted(entry->path().filename().string())) paths.push_back(entry->path().string());
  if (error) return absl::NotFoundError(absl::StrCat(dir, ": ", error.message()));
  std::sort(paths.begin(), paths.end());
  return paths;
}

std::string InDirectory(const std::string& dir, const std::string& path) {
  return (fs::path(dir) / path).string();  // an absolute path stays what it is
}

absl::StatusOr<std::string> FindPosesFile(const KittiOptions& options) {
  if (!options.poses.empty()) return InDirectory(options.dir, options.poses);
  std::error_code error;
  std::string usual = InDirectory(options.dir, "poses.txt");
  if (fs::exists(usual, error)) return usual;
  GEM_ASSIGN_OR_RETURN(std::vector<std::string> paths,
                       ListFiles(options.dir, [](const std::string& name) {
                         return absl::StartsWith(name, "poses") && absl::EndsWith(name, ".txt");
                       }));
  if (paths.size() == 1) return paths.front();
  if (paths.empty())
    return absl::NotFoundError(absl::StrCat(options.dir, ": no poses.txt, name the poses file"));
  return absl::InvalidArgumentError(
      absl::StrCat(options.dir, ": no poses.txt, name one of ", absl::StrJoin(paths, ", ")));
}

/// Tr of calib.txt: T_camera0_velodyne. Nothing if there is no such file or line.
absl::StatusOr<std::optional<RigidTransform>> ReadTr(const std::string& path) {
  std::error_code error;
  if (!fs::exists(path, error)) return std::optional<RigidTransform>();
  GEM_ASSIGN_OR_RETURN(const std::string contents, ReadFile(path, kCalibrationBytesMax));
  std::size_t line_number = 0;
  for (const absl::string_view line : absl::StrSplit(contents, '\n')) {
    ++line_number;
    if (!absl::StartsWith(line, "Tr:")) continue;
    const std::string where = absl::StrCat(path, ":", line_number);
    std::vector<double> numbers;
    for (const absl::string_view word :
         absl::StrSplit(line.substr(3), absl::ByAnyChar(" \t\r"), absl::SkipEmpty())) {
      double value = 0;
      if (!ParseNumber(word, value) || !std::isfinite(value))
        return absl::InvalidArgumentError(
            absl::StrCat(where, ": Tr holds \"", word.substr(0, 32), "\", want finite numbers"));
      numbers.push_back(value);
    }
    if (numbers.size() != 12)
      return absl::InvalidArgumentError(
          absl::StrCat(where, ": Tr has ", numbers.size(), " numbers, want 12"));
    GEM_ASSIGN_OR_RETURN(const RigidTransform Tr, ParsePose(where, numbers.data()));
    return std::optional<RigidTransform>(Tr);
  }
  return std::optional<RigidTransform>();
}

/// Decides whether poses are the camera's; if so, Tr is what turns them into the velodyne's.
absl::StatusOr<std::optional<RigidTransform>> CameraFromVelodyne(const KittiOptions& options,
                                                                 const std::string& poses_path) {
  const bool automatic = options.pose_frame == KittiPoseFrame::kAutomatic;
  if (options.pose_frame == KittiPoseFrame::kVelodyne) return std::optional<RigidTransform>();
  if (automatic && fs::path(poses_path).filename() != "poses.txt")
    return std::optional<RigidTransform>();
  const std::string path = InDirectory(options.dir, "calib.txt");
  GEM_ASSIGN_OR_RETURN(const std::optional<RigidTransform> Tr, ReadTr(path));
  if (!Tr && !automatic)
    return absl::NotFoundError(
        absl::StrCat(path, ": no line \"Tr:\", which poses of the camera need"));
  return Tr;
}

/// One pose a scan, of the velodyne.
absl::StatusOr<std::vector<RigidTransform>> ReadVelodynePoses(
    const std::string& path, const std::optional<RigidTransform>& Tr, const TimesFile& times) {
  GEM_ASSIGN_OR_RETURN(PoseFile file, ReadPoseFile(path));
  GEM_RETURN_IF_ERROR(CheckSameCount(file, times));
  if (Tr) {
    struct Camera;
    const Pose<Camera, Base> T_C_B = Tr->As<Camera, Base>();
    for (RigidTransform& pose : file.poses) {
      const Pose<Base, Base> moved = T_C_B.Inverse() * pose.As<Camera, Camera>() * T_C_B;
      pose = {moved.rotation(), moved.translation()};
    }
  }
  return std::move(file.poses);
}

}  // namespace

absl::StatusOr<KittiPoseFrame> ParseKittiPoseFrame(const std::string& text) {
  if (text == "auto") return KittiPoseFrame::kAutomatic;
  if (text == "velodyne") return KittiPoseFrame::kVelodyne;
  if (text == "camera") return KittiPoseFrame::kCamera;
  return absl::InvalidArgumentError(
      absl::StrCat("pose_frame is \"", text, "\", want auto, velodyne or camera"));
}

absl::StatusOr<std::unique_ptr<KittiSource>> KittiSource::Open(const KittiOptions& options) {
  std::unique_ptr<KittiSource> source(new KittiSource());
  // "dir/" has no file name of its own.
  const fs::path dir = fs::path(options.dir).lexically_normal();
  source->name_ = dir.has_filename() ? dir.filename() : dir.parent_path().filename();
  GEM_ASSIGN_OR_RETURN(source->noise_, MakeNoiseModel(LidarNoise{}));

  const std::string scans_dir = InDirectory(options.dir, "velodyne");
  GEM_ASSIGN_OR_RETURN(source->scan_paths_, ListFiles(scans_dir, [](const std::string& name) {
                         return absl::EndsWith(name, ".bin");
                       }));
  if (source->scan_paths_.empty())
    return absl::NotFoundError(absl::StrCat(scans_dir, ": no *.bin file"));

  GEM_ASSIGN_OR_RETURN(TimesFile times, ReadTimesFile(InDirectory(options.dir, "times.txt")));
  if (times.stamps_ns.size() != source->scan_paths_.size())
    return absl::InvalidArgumentError(absl::StrCat(times.path, " has ", times.stamps_ns.size(),
                                                   " times, but ", scans_dir, " has ",
                                                   source->scan_paths_.size(), " scans"));
  GEM_ASSIGN_OR_RETURN(const std::string poses_path, FindPosesFile(options));
  GEM_ASSIGN_OR_RETURN(const std::optional<RigidTransform> Tr,
                       CameraFromVelodyne(options, poses_path));
  GEM_ASSIGN_OR_RETURN(source->poses_, ReadVelodynePoses(poses_path, Tr, times));
  if (!options.corrected.empty()) {
    GEM_ASSIGN_OR_RETURN(source->corrected_,
                         ReadVelodynePoses(InDirectory(options.dir, options.corrected), Tr, times));
  }
  source->stamps_ns_ = std::move(times.stamps_ns);
  return source;
}

absl::StatusOr<bool> KittiSource::Next(SourceScan& scan) {
  if (next_ == scan_paths_.size()) return false;
  const std::string& path = scan_paths_[next_];
  GEM_ASSIGN_OR_RETURN(const std::string bytes, ReadFile(path, kScanBytesMax));
  if (bytes.size() % kPointBytes != 0)
    return absl::InvalidArgumentError(absl::StrCat(
        path, ": ", bytes.size(), " bytes, want a multiple of ", kPointBytes,
        ": the file ends within the point at offset ", bytes.size() / kPointBytes * kPointBytes));
  scan.points.clear();
  scan.points.reserve(bytes.size() / kPointBytes);
  for (std::size_t offset = 0; offset < bytes.size(); offset += kPointBytes) {
    float xyz[3];
    std::memcpy(xyz, bytes.data() + offset, sizeof(xyz));
    if (std::isfinite(xyz[0]) && std::isfinite(xyz[1]) && std::isfinite(xyz[2])) {
      scan.points.push_back({xyz[0], xyz[1], xyz[2], 0});
    } else {
      ++num_points_dropped_;
    }
  }
  scan.stamp_ns = stamps_ns_[next_];
  scan.T_O_B = poses_[next_].As<Odom, Base>();
  scan.T_G_B.reset();
  if (!corrected_.empty()) scan.T_G_B = corrected_[next_].As<Global, Base>();
  ++next_;
  return true;
}

}  // namespace gem
