// One robot on its way through the mappers, in this process and without a server: local mapper,
// submap builder, global mapper. What a session and a map do in the server, on one thread.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/scan_source.h"
#include "core/global/global_mapper.h"
#include "core/global/submap_builder.h"
#include "core/local/local_mapper.h"

namespace gem::evaluation {

struct RobotSetup {
  LocalMapOptions local;
  GlobalMapOptions map;  ///< its cell size is taken from `local`
  LocalBackend backend = LocalBackend::kCpu;
  Pose<Base, Sensor> T_B_S;
  NoiseModel noise;
  /// Of every pose (eqs. (4) and (11)); the server's defaults are zero, too.
  Eigen::Matrix3d rotation_covariance_rad2 = Eigen::Matrix3d::Zero();
  Eigen::Matrix3d translation_covariance_m2 = Eigen::Matrix3d::Zero();
};

class MappingRobot {
 public:
  /// INVALID_ARGUMENT names the option.
  static absl::StatusOr<std::unique_ptr<MappingRobot>> Make(const RobotSetup& setup);

  /// Fuses the scan at T_O_B; stamps increase.
  ScanReport Fuse(std::int64_t stamp_ns, const Pose<Odom, Base>& T_O_B,
                  std::span<const ScanPoint> points);
  ScanReport Fuse(const SourceScan& scan) { return Fuse(scan.stamp_ns, scan.T_O_B, scan.points); }

  /// Tells the map what is new and publishes it. With `show_local` the active submap and the local
  /// map lie on top, as in the server; without, finished submaps only are rendered.
  CommitReport Commit(bool show_local);
  /// Takes effect with the next Commit(). Errors are those of GlobalMapper::Correct.
  absl::StatusOr<CorrectionCounts> Correct(CorrectedTrajectory correction);
  /// The session ends: all cells enter the map, which is published.
  CommitReport End();

  const LocalMapper& mapper() const { return *mapper_; }
  std::shared_ptr<const MapSnapshot> snapshot() const { return map_.snapshot(); }

 private:
  MappingRobot(const RobotSetup& setup, std::unique_ptr<LocalMapper> mapper);

  // Constant after construction.
  const RobotSetup setup_;

  const std::unique_ptr<LocalMapper> mapper_;
  SubmapBuilder builder_;
  GlobalMapper map_;
  SessionUpdate update_;
  std::vector<EvictedCell> evicted_;
  std::uint64_t seq_ = 0;
};

}  // namespace gem::evaluation
