// A run through a city without its scans: where the robot was, what odometry said, what SLAM made
// of it. Read from published trajectories of KITTI 00, or invented where there are none.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "client/evaluation/experiment.h"
#include "core/geometry/pose.h"
#include "core/geometry/trajectory.h"

namespace gem::evaluation {

/// Poses of a LiDAR that is B, about 1.73 m over the street; z of G is up. Index: scan.
struct Drive {
  std::string name;         ///< "kiss-icp"
  std::string description;  ///< what it is and what is taken for the truth; Markdown
  std::vector<std::int64_t> stamps_ns;
  std::vector<Pose<Global, Base>> truth;
  std::vector<Pose<Odom, Base>> odometry;
  std::vector<Pose<Global, Base>> corrected;  ///< by SLAM, after the run

  std::size_t size() const { return stamps_ns.size(); }
};

/// Metres of the way of the truth.
double LengthOf(const Drive& drive);

/// The first `count` scans.
Drive FirstOf(Drive drive, std::size_t count);

/// Scan 0, n, 2 n and so on.
Drive EveryNth(const Drive& drive, std::size_t n);

/// Where the published trajectories lie: DIR/trajectories. Nothing without settings.data_dir, or if
/// there is no such folder.
std::optional<std::filesystem::path> TrajectoriesDir(const Settings& settings);

/// 4,541 scans of KITTI 00: odometry of KISS-ICP, and the same run after its pose graph was closed.
/// Truth: the closed trajectory, less its kinks.
absl::StatusOr<Drive> LoadKissIcpDrive(const std::filesystem::path& trajectories);

/// The same, but the closed trajectory is the truth as it was published, kinks and all.
absl::StatusOr<Drive> LoadKinkedKissIcpDrive(const std::filesystem::path& trajectories);

/// The same scans and truth as LoadKissIcpDrive, with ORB-SLAM's camera trajectory as odometry.
absl::StatusOr<Drive> LoadOrbDrive(const std::filesystem::path& trajectories);

/// 1,906 key scans of KITTI 00: odometry of an NDT LiDAR front end that drifts by 32 m, the same
/// run after g2o with loops and GNSS. Truth: place from RTK, attitude from g2o.
absl::StatusOr<Drive> LoadNdtDrive(const std::filesystem::path& trajectories);

/// Streets round some blocks, up and down by 12 m, driven twice in parts, for where there are no
/// recordings. Odometry drifts like LiDAR odometry times `drift_scale`; the corrected poses are the
/// truth.
Drive InventedDrive(std::size_t scans_max, double drift_scale, std::uint64_t seed);

/// A block of 60 x 40 m, round and round, never twice on quite the same line.
Drive RoundTheBlock(std::size_t num_scans, double scan_spacing_m, double drift_scale,
                    std::uint64_t seed);

/// Root mean square of the angle by which a turn from scan i to scan i + step differs between the
/// two, radians: how well they agree on a short stretch, wherever they have drifted to.
template <typename A, typename B>
double TurnDifferenceRms_rad(const std::vector<Pose<A, Base>>& a,
                             const std::vector<Pose<B, Base>>& b, std::size_t step) {
  double sum2 = 0;
  std::size_t count = 0;
  for (std::size_t i = 0; i + step < a.size(); ++i, ++count) {
    const Eigen::Quaterniond turn_a = a[i].rotation().conjugate() * a[i + step].rotation();
    const Eigen::Quaterniond turn_b = b[i].rotation().conjugate() * b[i + step].rotation();
    const double angle_rad = turn_a.angularDistance(turn_b);
    sum2 += angle_rad * angle_rad;
  }
  return count == 0 ? 0 : std::sqrt(sum2 / static_cast<double>(count));
}

}  // namespace gem::evaluation
