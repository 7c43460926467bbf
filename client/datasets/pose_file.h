// Pose and time files as KITTI has them: one 3x4 matrix [R | t] a line, one time in seconds a line.
// Knows nothing of scans.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "core/geometry/pose.h"
#include "core/geometry/trajectory.h"

namespace gem {

/// A rigid transform whose frames the file does not tell.
struct RigidTransform {
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();

  template <typename To, typename From>
  Pose<To, From> As() const {
    return {rotation, translation};
  }
};

/// Poses and the lines they stand in, from 1.
struct PoseFile {
  std::string path;
  std::vector<RigidTransform> poses;
  std::vector<std::size_t> lines;
};

/// Times and the lines they stand in, from 1.
struct TimesFile {
  std::string path;
  std::vector<std::int64_t> stamps_ns;  ///< strictly increasing
  std::vector<std::size_t> lines;
};

/// Twelve numbers a line: the rows of [R | t], metres. R must be orthonormal within 1e-3; the
/// nearest unit quaternion is kept. INVALID_ARGUMENT names file, line and value.
absl::StatusOr<PoseFile> ReadPoseFile(const std::string& path);

/// Twelve numbers [R | t], checked as above. `where` begins the error's text.
absl::StatusOr<RigidTransform> ParsePose(const std::string& where, const double* numbers);

/// One time in seconds a line, at most 9e9, strictly increasing; rounded to whole nanoseconds.
absl::StatusOr<TimesFile> ReadTimesFile(const std::string& path);

/// A trajectory from a pose file and a times file of as many lines.
template <typename A, typename B>
absl::StatusOr<std::vector<StampedPose<A, B>>> ReadStampedPoses(const std::string& poses_path,
                                                                const std::string& times_path);

/// INVALID_ARGUMENT: "poses.txt has 99 poses, but times.txt has 100 times".
absl::Status CheckSameCount(const PoseFile& poses, const TimesFile& times);

template <typename A, typename B>
absl::StatusOr<std::vector<StampedPose<A, B>>> ReadStampedPoses(const std::string& poses_path,
                                                                const std::string& times_path) {
  const absl::StatusOr<PoseFile> poses = ReadPoseFile(poses_path);
  if (!poses.ok()) return poses.status();
  const absl::StatusOr<TimesFile> times = ReadTimesFile(times_path);
  if (!times.ok()) return times.status();
  if (absl::Status status = CheckSameCount(*poses, *times); !status.ok()) return status;
  std::vector<StampedPose<A, B>> trajectory(poses->poses.size());
  for (std::size_t i = 0; i < trajectory.size(); ++i)
    trajectory[i] = {times->stamps_ns[i], poses->poses[i].template As<A, B>()};
  return trajectory;
}

}  // namespace gem
