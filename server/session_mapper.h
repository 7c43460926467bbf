// What a session does with its robot's messages: decodes, judges, finds the poses, deskews,
// fuses, and collects submaps. Single-threaded; the session's thread owns it. Knows no queue and no
// stream.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "core/geometry/trajectory.h"
#include "core/global/global_mapper.h"
#include "core/global/submap_builder.h"
#include "core/local/local_mapper.h"
#include "core/sensor/deskew.h"
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
  int local_threads = 1;
  LocalMapOptions local_map;
  GlobalMapOptions map;
  wire::ScanLimits scan_limits;
  wire::PoseCovariance default_covariance;  ///< of poses that come without
};

class SessionMapper {
 public:
  explicit SessionMapper(const SessionConfig& config);

  /// Poses of odometry between scans. What is not newer than the newest is skipped: a resumed
  /// stream may repeat itself. OUT_OF_ORDER if nothing is newer and a stamp was never seen.
  absl::Status AddPoses(const v1::PoseBatch& poses);

  enum class Deskewing : std::uint8_t { kNotNeeded, kDone, kNotPossible };
  /// A scan that was taken, decoded and judged.
  struct HeldScan {
    wire::DecodedScan scan;
    std::shared_ptr<const v1::Scan> message;  ///< kept if `scan` views its points
    const wire::SensorSetup* sensor = nullptr;
    TimeSpan span;  ///< from its first point to its last, the stamp included

    // Once it is ready.
    Pose<Odom, Base> T_O_B;
    Deskewing deskewing = Deskewing::kNotNeeded;

    std::uint64_t size_bytes() const {
      return scan.points.size() * sizeof(ScanPoint) +
             (scan.inflated != nullptr ? scan.inflated->size() : 0) +
             scan.time_offsets_s.size() * sizeof(float);
    }
  };

  /// Judges all of the scan but its order. A refusal names the field and carries a ProblemReason.
  /// Call Recycle(held) when done with it, whatever became of it.
  absl::Status Take(std::shared_ptr<const v1::Scan> scan, HeldScan& held);

  enum class Readiness { kReady, kWaits };
  /// Looks for the poses of a scan all of whose predecessors are done. It waits if streamed poses
  /// that it needs may come; `gave_up` says why it cannot wait any longer, and is empty if it can.
  /// An error refuses the scan: OUT_OF_ORDER for its stamp, NO_POSE.
  absl::StatusOr<Readiness> Prepare(HeldScan& held, absl::string_view gave_up) const;
  /// Fuses a scan that is ready.
  ScanReport Fuse(HeldScan& held);
  /// Keeps the buffers for the next scan.
  void Recycle(HeldScan&& held) { spare_ = std::move(held.scan); }

  bool fused_any() const { return fused_any_; }
  bool has_finished_submaps() const { return !update_.finished.empty(); }

  /// The local map as it is now, for readers.
  std::shared_ptr<const LocalMap> CopyLocalMap() const;
  /// What the map has not heard yet; complete with the active submap and `local_map`.
  SessionUpdate TakeUpdate(std::shared_ptr<const LocalMap> local_map);
  /// The last update: all cells leave the local map.
  SessionUpdate End();

 private:
  /// True if a pose with the stamp was added, as far as is remembered.
  bool Knows(std::int64_t stamp_ns) const;
  absl::Status RefuseForPose(const HeldScan& held, absl::string_view gave_up) const;
  void AppendOdometry(const HeldScan& held);

  // Constant after construction.
  const SessionConfig config_;

  std::unique_ptr<LocalMapper> mapper_;
  SubmapBuilder builder_;
  Trajectory<Odom, Base> streamed_;  ///< poses between scans
  bool streamed_dropped_ = false;    ///< older poses than the oldest were forgotten
  wire::DecodedScan spare_;          ///< buffers for the next scan
  std::vector<EvictedCell> evicted_;
  SessionUpdate update_;
  std::optional<std::int64_t> last_stamp_ns_;     ///< of the newest fused scan
  std::optional<std::int64_t> last_odometry_ns_;  ///< newest that was put into an update
  bool fused_any_ = false;
};

}  // namespace gem
