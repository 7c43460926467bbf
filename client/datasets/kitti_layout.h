// What KITTI's directories have in common, whatever the sensor: where files lie, calib.txt, and
// what the rows of pose files are the poses of.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "client/camera/camera_model.h"
#include "client/datasets/pose_file.h"

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

/// Camera 0, which calib.txt and the poses of the odometry benchmark refer to. Never instantiated.
struct Camera0;

/// Of a path that may have a slash at its end.
std::string DirectoryName(const std::string& dir);

/// `path` below `dir`; an absolute path stays what it is.
std::string InDirectory(const std::string& dir, const std::string& path);

/// Paths of the files of `dir` whose names begin and end so, by name. NOT_FOUND if there is no such
/// directory.
absl::StatusOr<std::vector<std::string>> ListFiles(const std::string& dir, absl::string_view begin,
                                                   absl::string_view end);

/// `poses` if it is not empty, else poses.txt, or else the only poses*.txt.
absl::StatusOr<std::string> FindPosesFile(const std::string& dir, const std::string& poses);

/// The twelve numbers of the line "KEY: ..." of calib.txt. Nothing if there is no such file or
/// line.
absl::StatusOr<std::optional<std::array<double, 12>>> ReadCalibrationLine(const std::string& path,
                                                                          const std::string& key);

/// Line Tr of calib.txt. Nothing if there is no such file or line.
absl::StatusOr<std::optional<Pose<Camera0, Base>>> ReadTr(const std::string& path);

/// A rectified camera of calib.txt: P = K * [I | t].
struct KittiCamera {
  CameraModel model;
  Pose<Camera, Camera0> T_C_C0;  ///< a translation: rectified images share one orientation
};

/// Line P0 to P3 of calib.txt. NOT_FOUND if it is missing.
absl::StatusOr<KittiCamera> ReadKittiCamera(const std::string& path, int number);

/// Poses T_O_B; the rows of the file are those of camera 0 if T_C0_B is there, else those of the
/// base. O is the first base frame if the file begins with the identity.
absl::StatusOr<PoseFile> ReadBasePoses(const std::string& path,
                                       const std::optional<Pose<Camera0, Base>>& T_C0_B);

}  // namespace gem
