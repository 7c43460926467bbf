// Scans of a KITTI directory: velodyne/*.bin, times.txt and pose files. Everything but the points
// is read and checked when the source is opened.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "client/datasets/pose_file.h"
#include "client/scan_source.h"

namespace gem {

/// What the rows of KITTI's pose files are the poses of.
enum class KittiPoseFrame {
  /// kCamera if the poses file is called poses.txt and calib.txt has a line "Tr" (the layout of the
  /// odometry benchmark), else kVelodyne.
  kAutomatic,
  /// T_G_velodyne.
  kVelodyne,
  /// Camera 0 against its first pose: T_G_velodyne = Tr^-1 * P * Tr, so that G is the first
  /// velodyne frame.
  kCamera,
};

/// "auto", "velodyne" or "camera".
absl::StatusOr<KittiPoseFrame> ParseKittiPoseFrame(const std::string& text);

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

 private:
  KittiSource() = default;

  std::string name_;
  NoiseModel noise_;
  std::vector<std::string> scan_paths_;
  std::vector<std::int64_t> stamps_ns_;
  std::vector<RigidTransform> poses_;
  std::vector<RigidTransform> corrected_;  // empty: none
  std::size_t next_ = 0;
  std::uint64_t num_points_dropped_ = 0;
};

}  // namespace gem
