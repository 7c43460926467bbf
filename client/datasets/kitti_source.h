// Scans of a KITTI directory: velodyne/*.bin, times.txt and pose files, coloured by a camera if
// wanted. Everything but the points and the images is read and checked when the source is opened.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/camera/camera_model.h"
#include "client/datasets/kitti_layout.h"
#include "client/scan_source.h"

namespace gem {

struct KittiOptions {
  /// Holds velodyne/*.bin (float32 x y z intensity), times.txt (seconds, one a line) and the pose
  /// files.
  std::string dir;
  /// Odometry, one row a scan; relative to dir or absolute. Empty: poses.txt, or else the only
  /// poses*.txt.
  std::string poses;
  /// SLAM's corrected poses, one row a scan; relative to dir or absolute. Empty: none.
  std::string corrected;
  /// Of both pose files.
  KittiPoseFrame pose_frame = KittiPoseFrame::kAutomatic;
  /// Colours the points: directory with a PNG for each scan, of the scan's name; image_0 to
  /// image_3, the cameras that P0 to P3 of calib.txt describe. Needs Tr. Empty: no colours.
  std::string color_images = {};
};

/// The base B is the velodyne itself: T_B_S is the identity. Not thread-safe.
class KittiSource : public ScanSource {
 public:
  /// Errors name the file, the line and the value.
  static absl::StatusOr<std::unique_ptr<KittiSource>> Open(const KittiOptions& options);

  std::string name() const override { return name_; }
  std::size_t num_scans() const override { return scan_paths_.size(); }
  Pose<Base, Sensor> T_B_S() const override { return {}; }
  NoiseModel noise() const override { return noise_; }
  absl::StatusOr<bool> Next(SourceScan& scan) override;

  /// Points that were not finite, so far.
  std::uint64_t num_points_dropped() const { return num_points_dropped_; }
  /// Points that an image coloured, so far.
  std::uint64_t num_points_colored() const { return num_points_colored_; }
  /// Scans without an image, so far; 0 if none was asked for.
  std::uint64_t num_scans_without_image() const { return num_scans_without_image_; }

 private:
  /// The camera that colours the points.
  struct ColorCamera {
    std::string dir;
    CameraModel model;
    Pose<Camera, Sensor> T_C_S;
  };

  KittiSource() = default;
  static absl::StatusOr<ColorCamera> OpenColorCamera(const KittiOptions& options,
                                                     const std::vector<std::string>& scan_paths);
  absl::Status ReadPoints(const std::string& path, std::vector<ScanPoint>& points);
  absl::Status ColorPoints(const std::string& scan_path, std::vector<ScanPoint>& points);

  std::string name_;
  NoiseModel noise_;
  std::vector<std::string> scan_paths_;
  std::vector<std::int64_t> stamps_ns_;
  std::vector<RigidTransform> poses_;
  std::vector<RigidTransform> corrected_;  // empty: none
  std::optional<ColorCamera> color_camera_;
  std::size_t next_ = 0;
  std::uint64_t num_points_dropped_ = 0;
  std::uint64_t num_points_colored_ = 0;
  std::uint64_t num_scans_without_image_ = 0;
};

}  // namespace gem
