// The global dense mapper (paper section V): all submaps of one map, moved by corrections, merged,
// rendered to tiles. Single-threaded: one map actor owns it. What it publishes is immutable.
// Rendering may use threads of its own.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "core/base/cancel_token.h"
#include "core/geometry/pose.h"
#include "core/global/correction.h"
#include "core/global/global_map_options.h"
#include "core/global/map_snapshot.h"
#include "core/global/map_state.h"
#include "core/global/retraction.h"
#include "core/global/submap.h"
#include "core/local/local_map.h"

namespace gem {

/// What one session tells the map since it last did: what is new of its odometry and its finished
/// submaps, and what is active now.
struct SessionUpdate {
  std::vector<StampedPose<Odom, Base>> odometry;        ///< newer than all before, increasing
  std::vector<std::shared_ptr<const Submap>> finished;  ///< in order
  std::shared_ptr<const Submap> active;                 ///< replaces the last; null: there is none
  std::shared_ptr<const LocalMap> local_map;            ///< replaces the last; null: there is none
  bool ended = false;  ///< no update follows; active and local_map are null
};

/// Wall time of the stages of one commit, seconds; 0 for a stage that did not run.
struct GlobalStageSeconds {
  double finish = 0;   ///< adopting finished submaps
  double merge = 0;    ///< maintenance
  double deform = 0;   ///< new poses of submaps and what they touch
  double compose = 0;  ///< rendering
  double coarsen = 0;  ///< levels above 0
};

struct CommitReport {
  GlobalStageSeconds seconds;
  std::uint32_t num_moved_submaps = 0;
  std::uint32_t num_touched_tiles = 0;  ///< rendered
  std::uint32_t num_merged_submaps = 0;
  bool cancelled = false;
};

class GlobalMapper {
 public:
  /// options are valid. epoch: the version's epoch.
  GlobalMapper(const GlobalMapOptions& options, std::uint64_t epoch);
  /// The map of a state, of whose sessions none goes on: each is ended, with a submap and a local
  /// map that stay as they were. The state is valid. The first Commit publishes it, the same cells
  /// as before. RESOURCE_EXHAUSTED if it may fill more than tiles_max tiles.
  static absl::StatusOr<std::unique_ptr<GlobalMapper>> FromState(const MapState& state,
                                                                 std::uint64_t epoch,
                                                                 std::uint64_t tiles_max);
  ~GlobalMapper();
  GlobalMapper(const GlobalMapper&) = delete;
  GlobalMapper& operator=(const GlobalMapper&) = delete;

  /// Adds a session. ALREADY_EXISTS if the id is taken.
  absl::Status AddSession(const std::string& session, const std::string& robot,
                          const Pose<Global, Odom>& T_G_O);

  /// NOT_FOUND for an unknown session, FAILED_PRECONDITION for one that has ended, INVALID_ARGUMENT
  /// for stamps that do not increase and for submaps of another session or cell size; then nothing
  /// of it is taken. Takes effect with the next Commit.
  absl::Status Update(const std::string& session, SessionUpdate update);

  /// Replaces the session's correction; a session that has ended is corrected like any other.
  /// NOT_FOUND for an unknown session; INVALID_ARGUMENT for an empty list or stamps that do not
  /// increase; OUT_OF_RANGE if every stamp lies before the session began, or after it ended. Takes
  /// effect with the next Commit.
  absl::StatusOr<CorrectionCounts> Correct(const std::string& session,
                                           CorrectedTrajectory correction);

  /// Hides what the session contributed: its submaps, the active one and those to come, its local
  /// map, and its cells in others' submaps; or brings it back. A cell that was fused from several
  /// sessions is hidden with the first of them. Nothing happens if it is so already. NOT_FOUND.
  /// Takes effect with the next Commit.
  absl::StatusOr<RetractionCounts> Retract(const std::string& session, bool restore);

  /// Moves, merges and renders what has changed since the last published snapshot, and publishes it
  /// as one revision; returns the newest snapshot, which is the old one if nothing changed. When
  /// `cancel` is raised in mid-work nothing is published, nothing is lost, and the next Commit does
  /// it all from the newest poses.
  std::shared_ptr<const MapSnapshot> Commit(const CancelToken& cancel, CommitReport& report);

  /// Never null.
  std::shared_ptr<const MapSnapshot> snapshot() const { return snapshot_; }

  /// What the newest snapshot was made of, if nothing has been told since. Copies trajectories and
  /// shares the rest.
  MapState State() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
  std::shared_ptr<const MapSnapshot> snapshot_;
};

}  // namespace gem
