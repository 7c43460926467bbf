// Scans of the stereo camera of a KITTI odometry directory: rectified pairs image_2 and image_3 (or
// image_0 and image_1), calib.txt and poses. Everything but the images is read and checked when the
// source is opened.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/camera/camera_model.h"
#include "client/camera/stereo_matcher.h"
#include "client/datasets/kitti_layout.h"
#include "client/scan_source.h"

namespace gem {

struct KittiStereoOptions {
  /// Holds image_2/*.png and image_3/*.png, or image_0 and image_1; calib.txt with their P; pose
  /// files; times.txt (seconds, one a line), without which pairs are 0.1 s apart.
  std::string dir;
  /// Odometry, one row a pair; relative to dir or absolute. Empty: poses.txt, or else the only
  /// poses*.txt.
  std::string poses;
  /// SLAM's corrected poses, one row a pair; relative to dir or absolute. Empty: none.
  std::string corrected;
  /// Of both pose files. Without Tr in calib.txt they can only be the camera's.
  KittiPoseFrame pose_frame = KittiPoseFrame::kAutomatic;
  StereoMatcherOptions matcher;
  /// Points farther from the camera are left out: the error of a depth grows with its square, 0.5 m
  /// at 20 m. Range (0, 1000].
  double range_m_max = 20;
  /// Every so many pixels of a row and every so many rows give a point: neighbours share most of
  /// what was compared, so they tell little that is new. Range [1, 64].
  std::int32_t pixel_step = 2;
};

/// The base B is the velodyne if calib.txt has a Tr, as for KittiSource, so that maps of both
/// agree. Else it is at camera 0, x forward, y left, z up, and pitched so that on average the car
/// moves along x: the cameras of KITTI look down by 1 to 2 degrees. O is B at the first pose. Not
/// thread-safe.
class KittiStereoSource : public ScanSource {
 public:
  /// Errors name the file, the line and the value.
  static absl::StatusOr<std::unique_ptr<KittiStereoSource>> Open(const KittiStereoOptions& options);

  std::string name() const override { return name_; }
  std::size_t num_scans() const override { return left_paths_.size(); }
  /// S is the left camera: x right, y down, z along the optical axis.
  Pose<Base, Sensor> T_B_S() const override { return T_B_S_; }
  NoiseModel noise() const override { return noise_; }
  /// Points with the colour of their pixel, by rows.
  absl::StatusOr<bool> Next(SourceScan& scan) override;

  double baseline_m() const { return baseline_m_; }

 private:
  KittiStereoSource() = default;
  absl::Status OpenImages(const std::string& dir);
  absl::Status OpenCameras(const std::string& calibration_path);
  absl::Status OpenPoses(const KittiStereoOptions& options);

  std::string name_;
  double range_m_max_ = 0;
  std::int32_t pixel_step_ = 1;
  int left_camera_ = 0;  // 0 or 2; the right one follows
  std::vector<std::string> left_paths_;
  std::vector<std::string> right_paths_;
  CameraModel model_;
  double baseline_m_ = 0;
  Pose<Camera, Camera0> T_C_C0_;  // C: the left camera
  Pose<Base, Sensor> T_B_S_;
  NoiseModel noise_;
  std::vector<std::int64_t> stamps_ns_;
  std::vector<RigidTransform> poses_;
  std::vector<RigidTransform> corrected_;  // empty: none
  std::unique_ptr<StereoMatcher> matcher_;
  DisparityImage disparity_;
  std::size_t next_ = 0;
};

}  // namespace gem
