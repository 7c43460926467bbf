// What a session does with its robot's messages: decodes, judges, orders, finds the pose, fuses,
// and collects submaps. Single-threaded; the session's thread owns it. Knows no queue and no
// stream.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "core/geometry/trajectory.h"
#include "core/global/global_mapper.h"
#include "core/global/submap_builder.h"
#include "core/local/local_mapper.h"
#include "proto/wire/scan.h"
#include "proto/wire/session_setup.h"

namespace gem::v1 {
class PoseBatch;
class Scan;
}  // namespace gem::v1

namespace gem {

/// Everything a session is made with. Valid: its options were validated when it was opened.
struct SessionConfig {
  wire::SessionSetup setup;
  LocalBackend backend = LocalBackend::kCpu;
  LocalMapOptions local_map;
  GlobalMapOptions map;
  wire::ScanLimits scan_limits;
  wire::PoseCovariance default_covariance;  ///< of poses that come without
};

class SessionMapper {
 public:
  explicit SessionMapper(const SessionConfig& config);

  /// Poses of odometry between scans. What is not newer than the newest is skipped (a resumed
  /// stream may repeat itself); OUT_OF_ORDER if nothing is newer.
  absl::Status AddPoses(const v1::PoseBatch& poses);

  enum class Intake { kTaken, kDuplicate };
  /// Judges the scan and holds it. A refusal names the field and carries a ProblemReason; like a
  /// scan that is taken it uses up its sequence number, unless that is out of line.
  absl::StatusOr<Intake> Take(const v1::Scan& scan, std::uint64_t seq);

  enum class PoseSearch {
    kFound,
    kMayCome,  ///< the newest streamed pose is older than the scan
    kNone
  };
  /// Looks for the pose of the scan that is held.
  PoseSearch FindPose();
  /// NO_POSE for the scan that is held.
  absl::Status RefuseForPose() const;
  /// Fuses the scan that is held. FindPose() said kFound.
  ScanReport Fuse();

  /// Last sequence number that was used up.
  std::uint64_t last_seq() const { return last_seq_; }
  bool fused_any() const { return fused_any_; }
  bool has_finished_submaps() const { return !update_.finished.empty(); }

  /// The local map as it is now, for readers.
  std::shared_ptr<const LocalMap> CopyLocalMap() const;
  /// What the map has not heard yet; complete with the active submap and `local_map`.
  SessionUpdate TakeUpdate(std::shared_ptr<const LocalMap> local_map);
  /// The last update: all cells leave the local map.
  SessionUpdate End();

 private:
  absl::Status CheckOrder(std::uint64_t seq) const;
  void AppendOdometry();

  // Constant after construction.
  const SessionConfig config_;

  std::unique_ptr<LocalMapper> mapper_;
  SubmapBuilder builder_;
  Trajectory<Odom, Base> streamed_;            ///< poses between scans
  wire::DecodedScan scan_;                     ///< held between Take() and Fuse()
  const wire::SensorSetup* sensor_ = nullptr;  ///< of scan_
  Pose<Odom, Base> T_O_B_;                     ///< of scan_, once found
  std::vector<EvictedCell> evicted_;
  SessionUpdate update_;
  std::uint64_t last_seq_ = 0;
  std::optional<std::int64_t> last_stamp_ns_;     ///< of the newest fused scan
  std::optional<std::int64_t> last_odometry_ns_;  ///< newest that was put into an update
  bool fused_any_ = false;
};

}  // namespace gem
