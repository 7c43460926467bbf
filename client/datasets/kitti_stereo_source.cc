#include "client/datasets/kitti_stereo_source.h"

#include <cmath>
#include <filesystem>
#include <optional>
#include <utility>

#include "absl/strings/str_cat.h"
#include "client/camera/project_colors.h"
#include "client/formats/png_file.h"
#include "core/base/status_macros.h"

namespace gem {
namespace {

namespace fs = std::filesystem;

constexpr std::int64_t kPeriod_ns = 100'000'000;  // KITTI's cameras run at 10 Hz
constexpr double kPathMin_m = 5;  // shorter paths do not tell how a camera is pitched
constexpr double kStepMin_m = 0.05;

/// Rotation of a base with x forward, y left, z up into camera axes, for a camera that looks down
/// by so much.
Pose<Camera0, Base> CameraFromLevelBase(double pitch_down_rad) {
  Eigen::Matrix3d nominal;
  nominal << 0, -1, 0, 0, 0, -1, 1, 0, 0;
  // A camera that looks down sees what lies ahead of it higher in its image: at negative y.
  const Eigen::AngleAxisd tilt(pitch_down_rad, Eigen::Vector3d::UnitX());
  return {Eigen::Quaterniond(tilt * nominal).normalized(), Eigen::Vector3d::Zero()};
}

/// How far camera 0 looks down against the direction in which it is driven; 0 if it hardly moves.
double PitchDown_rad(const std::vector<RigidTransform>& camera_poses) {
  double forward_m = 0, down_m = 0;
  for (std::size_t i = 1; i < camera_poses.size(); ++i) {
    const Eigen::Vector3d step = camera_poses[i - 1].rotation.conjugate() *
                                 (camera_poses[i].translation - camera_poses[i - 1].translation);
    if (step.z() < kStepMin_m) continue;  // stands, or drives backwards
    forward_m += step.z();
    down_m += step.y();
  }
  return forward_m < kPathMin_m ? 0 : std::atan2(-down_m, forward_m);
}

absl::StatusOr<std::vector<RigidTransform>> ReadPairPoses(
    const std::string& path, const std::optional<Pose<Camera0, Base>>& T_C0_B,
    std::size_t num_pairs) {
  GEM_ASSIGN_OR_RETURN(PoseFile file, ReadBasePoses(path, T_C0_B));
  if (file.poses.size() != num_pairs)
    return absl::InvalidArgumentError(absl::StrCat(path, " has ", file.poses.size(),
                                                   " poses, but there are ", num_pairs, " pairs"));
  return std::move(file.poses);
}

}  // namespace

absl::StatusOr<std::unique_ptr<KittiStereoSource>> KittiStereoSource::Open(
    const KittiStereoOptions& options) {
  if (!(options.range_m_max > 0 && options.range_m_max <= 1000))
    return absl::InvalidArgumentError(
        absl::StrCat("stereo.range_m_max is ", options.range_m_max, ", want (0, 1000]"));
  if (options.pixel_step < 1 || options.pixel_step > 64)
    return absl::InvalidArgumentError(
        absl::StrCat("stereo.pixel_step is ", options.pixel_step, ", want [1, 64]"));
  std::unique_ptr<KittiStereoSource> source(new KittiStereoSource());
  source->name_ = DirectoryName(options.dir);
  source->range_m_max_ = options.range_m_max;
  source->pixel_step_ = options.pixel_step;
  GEM_ASSIGN_OR_RETURN(source->matcher_, StereoMatcher::Make(options.matcher));
  GEM_RETURN_IF_ERROR(source->OpenImages(options.dir));
  GEM_RETURN_IF_ERROR(source->OpenCameras(InDirectory(options.dir, "calib.txt")));
  GEM_RETURN_IF_ERROR(source->OpenPoses(options));
  return source;
}

absl::Status KittiStereoSource::OpenImages(const std::string& dir) {
  std::error_code error;
  left_camera_ = fs::exists(InDirectory(dir, "image_2"), error) ? 2 : 0;
  const std::string left_dir = InDirectory(dir, absl::StrCat("image_", left_camera_));
  const std::string right_dir = InDirectory(dir, absl::StrCat("image_", left_camera_ + 1));
  GEM_ASSIGN_OR_RETURN(left_paths_, ListFiles(left_dir, "", ".png"));
  if (left_paths_.empty()) return absl::NotFoundError(absl::StrCat(left_dir, ": no *.png file"));
  for (const std::string& left : left_paths_) {
    right_paths_.push_back(InDirectory(right_dir, fs::path(left).filename().string()));
    if (!fs::exists(right_paths_.back(), error))
      return absl::NotFoundError(
          absl::StrCat(right_paths_.back(), ": no such file, the other half of ", left));
  }
  return absl::OkStatus();
}

absl::Status KittiStereoSource::OpenCameras(const std::string& calibration_path) {
  GEM_ASSIGN_OR_RETURN(const KittiCamera left, ReadKittiCamera(calibration_path, left_camera_));
  GEM_ASSIGN_OR_RETURN(const KittiCamera right,
                       ReadKittiCamera(calibration_path, left_camera_ + 1));
  if (!(left.model == right.model))
    return absl::InvalidArgumentError(
        absl::StrCat(calibration_path, ": P", left_camera_, " and P", left_camera_ + 1,
                     " differ in focal length or centre, want those of a rectified pair"));
  model_ = left.model;
  T_C_C0_ = left.T_C_C0;
  baseline_m_ = left.T_C_C0.translation().x() - right.T_C_C0.translation().x();
  if (!(baseline_m_ > 0))
    return absl::InvalidArgumentError(
        absl::StrCat(calibration_path, ": camera ", left_camera_ + 1, " is ", baseline_m_,
                     " m to the right of camera ", left_camera_, ", want a positive baseline"));
  StereoNoise noise;
  noise.focal_length_px = static_cast<float>(model_.fx_px);
  noise.baseline_m = static_cast<float>(baseline_m_);
  GEM_ASSIGN_OR_RETURN(noise_, MakeNoiseModel(noise));
  return absl::OkStatus();
}

absl::Status KittiStereoSource::OpenPoses(const KittiStereoOptions& options) {
  const std::string times_path = InDirectory(options.dir, "times.txt");
  std::error_code error;
  if (fs::exists(times_path, error)) {
    GEM_ASSIGN_OR_RETURN(TimesFile times, ReadTimesFile(times_path));
    if (times.stamps_ns.size() != num_scans())
      return absl::InvalidArgumentError(absl::StrCat(times_path, " has ", times.stamps_ns.size(),
                                                     " times, but there are ", num_scans(),
                                                     " pairs"));
    stamps_ns_ = std::move(times.stamps_ns);
  } else {
    for (std::size_t i = 0; i < num_scans(); ++i)
      stamps_ns_.push_back(static_cast<std::int64_t>(i) * kPeriod_ns);
  }

  const std::string calibration_path = InDirectory(options.dir, "calib.txt");
  GEM_ASSIGN_OR_RETURN(const std::string path, FindPosesFile(options.dir, options.poses));
  GEM_ASSIGN_OR_RETURN(auto T_C0_B, ReadTr(calibration_path));
  const bool of_camera = options.pose_frame == KittiPoseFrame::kCamera ||
                         (options.pose_frame == KittiPoseFrame::kAutomatic &&
                          (!T_C0_B || fs::path(path).filename() == "poses.txt"));
  if (!T_C0_B && !of_camera)
    return absl::NotFoundError(
        absl::StrCat(calibration_path, ": no line \"Tr:\", which poses of the velodyne need"));
  if (!T_C0_B) {
    GEM_ASSIGN_OR_RETURN(const PoseFile raw, ReadPoseFile(path));
    T_C0_B = CameraFromLevelBase(PitchDown_rad(raw.poses));
  }
  const auto rows_of = of_camera ? T_C0_B : std::nullopt;
  GEM_ASSIGN_OR_RETURN(poses_, ReadPairPoses(path, rows_of, num_scans()));
  if (!options.corrected.empty()) {
    GEM_ASSIGN_OR_RETURN(corrected_, ReadPairPoses(InDirectory(options.dir, options.corrected),
                                                   rows_of, num_scans()));
  }
  const Pose<Camera, Sensor> T_C_S;  // the left camera is the sensor
  T_B_S_ = T_C0_B->Inverse() * T_C_C0_.Inverse() * T_C_S;
  return absl::OkStatus();
}

absl::StatusOr<bool> KittiStereoSource::Next(SourceScan& scan) {
  if (next_ == num_scans()) return false;
  GEM_ASSIGN_OR_RETURN(const Image left, ReadPng(left_paths_[next_]));
  GEM_ASSIGN_OR_RETURN(const Image right, ReadPng(right_paths_[next_]));
  if (absl::Status status = matcher_->Match(left, right, disparity_); !status.ok())
    return absl::Status(status.code(), absl::StrCat(left_paths_[next_], ": ", status.message()));
  scan.points.clear();
  for (std::int32_t v = 0; v < left.height; v += pixel_step_) {
    for (std::int32_t u = 0; u < left.width; u += pixel_step_) {
      const double disparity_px = disparity_.At(u, v);
      if (disparity_px <= 0) continue;
      const double z_m = model_.fx_px * baseline_m_ / disparity_px;
      const double x_m = (u - model_.cx_px) / model_.fx_px * z_m;
      const double y_m = (v - model_.cy_px) / model_.fy_px * z_m;
      if (x_m * x_m + y_m * y_m + z_m * z_m > range_m_max_ * range_m_max_) continue;
      scan.points.push_back({static_cast<float>(x_m), static_cast<float>(y_m),
                             static_cast<float>(z_m), RgbaOf(left.At(u, v))});
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
