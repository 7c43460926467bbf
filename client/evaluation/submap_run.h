// A local mapper and a submap builder on a drive, and what they made: odometry and finished
// submaps, to be given to as many global mappers as one likes, corrected in as many ways.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "core/global/global_mapper.h"
#include "core/global/submap_builder.h"
#include "core/local/local_mapper.h"

namespace gem::evaluation {

struct SubmapRun {
  struct Finished {
    std::size_t scan = 0;  ///< at which it was finished
    std::shared_ptr<const Submap> submap;
  };
  std::vector<StampedPose<Odom, Base>> odometry;  ///< one a scan
  std::vector<Finished> finished;                 ///< in order
};

/// Sensor at B, noise of a LiDAR, certain poses: the server's defaults.
class SubmapRecorder {
 public:
  /// INVALID_ARGUMENT names the option.
  static absl::StatusOr<std::unique_ptr<SubmapRecorder>> Make(const LocalMapOptions& local,
                                                              float submap_length_m);

  /// What one scan cost. Seconds.
  struct Cost {
    ScanReport local;
    double submap_s = 0;  ///< building submaps, on top of local.seconds
  };
  Cost Fuse(std::int64_t stamp_ns, const Pose<Odom, Base>& T_O_B,
            std::span<const ScanPoint> points);
  /// Every cell enters a submap; nothing may follow.
  void End();

  const SubmapRun& run() const { return run_; }

 private:
  SubmapRecorder(const GlobalMapOptions& map, const NoiseModel& noise,
                 std::unique_ptr<LocalMapper> mapper);

  const NoiseModel noise_;
  const std::unique_ptr<LocalMapper> mapper_;
  SubmapBuilder builder_;
  SubmapRun run_;
  std::vector<EvictedCell> evicted_;
};

/// A global mapper that is told a run step by step. The run must outlive it.
class MapReplay {
 public:
  /// options are valid; the cell size is taken from the run's submaps.
  MapReplay(const SubmapRun& run, GlobalMapOptions options, const Pose<Global, Odom>& T_G_O);

  /// Tells everything up to and including this scan.
  void TellUntil(std::size_t scan);
  /// Takes effect with the next Commit().
  absl::Status Correct(CorrectedTrajectory correction);
  CommitReport Commit();

  const MapSnapshot& snapshot() const { return *map_.snapshot(); }

 private:
  const SubmapRun& run_;
  GlobalMapper map_;
  std::size_t next_scan_ = 0;
  std::size_t next_submap_ = 0;
};

/// The first `count` poses with the stamps of the run.
CorrectedTrajectory CorrectionOf(const SubmapRun& run,
                                 const std::vector<Pose<Global, Base>>& corrected,
                                 std::size_t count);

}  // namespace gem::evaluation
