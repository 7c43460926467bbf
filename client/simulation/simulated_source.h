// A robot that drives through a simulated world and scans it: a ScanSource whose truth is known.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "client/scan_source.h"
#include "client/simulation/drift.h"
#include "client/simulation/lidar.h"
#include "client/simulation/path.h"
#include "client/simulation/world.h"

namespace gem {

/// A stretch of the way on which the sensor is silent: [begin_m, end_m).
struct SilentStretch {
  double begin_m = 0;
  double end_m = 0;
};

struct RobotOptions {
  double scan_period_s = 0.1;  ///< at least a microsecond
  /// Way from one scan to the next; 0: the robot stands at the beginning of its path.
  double scan_spacing_m = 0.45;
  /// Of the sensor over the base, metres; the base is on the ground.
  double sensor_height_m = 1.73;
  /// Whether the base leans with the ground or only follows its height.
  bool leans = true;
};

/// All that a SimulatedSource is made of.
struct Simulation {
  explicit Simulation(Path driven) : path(std::move(driven)) {}

  std::string name;
  std::unique_ptr<const World> world;
  LidarOptions lidar;
  RobotOptions robot;
  Path path;
  std::size_t num_steps = 0;  ///< scans, silent ones included
  DriftRates drift;
  std::vector<DriftJump> jumps;  ///< in the order of their way
  std::vector<SilentStretch> silences;
  std::uint64_t seed = 1;
};

/// A pose of the robot at a scan.
struct SimulatedPose {
  std::int64_t stamp_ns = 0;
  double way_m = 0;
  Pose<Global, Base> T_G_B;  ///< the truth
  Pose<Odom, Base> T_O_B;    ///< what odometry says; equal to the truth at the first scan
};

/// Not thread-safe.
class SimulatedSource final : public ScanSource {
 public:
  /// FAILED_PRECONDITION where the path leaves the ground; names the place.
  static absl::StatusOr<std::unique_ptr<SimulatedSource>> Make(Simulation simulation);

  std::string name() const override { return name_; }
  std::size_t num_scans() const override { return poses_.size(); }
  Pose<Base, Sensor> T_B_S() const override { return T_B_S_; }
  /// The data sheet's, whatever noise the simulation really has.
  NoiseModel noise() const override { return noise_; }
  absl::StatusOr<bool> Next(SourceScan& scan) override;

  const World& world() const { return *world_; }
  const Lidar& lidar() const { return lidar_; }
  /// Of every scan, past and to come.
  const std::vector<SimulatedPose>& poses() const { return poses_; }
  /// What walkers' clocks say at a stamp: they start with the first scan.
  static double WorldTime(std::int64_t stamp_ns);

 private:
  SimulatedSource(Simulation simulation, std::vector<SimulatedPose> poses, NoiseModel noise);

  // Constant after construction.
  const std::string name_;
  const std::unique_ptr<const World> world_;
  const Lidar lidar_;
  const Pose<Base, Sensor> T_B_S_;
  const NoiseModel noise_;
  const std::uint64_t seed_;
  const std::vector<SimulatedPose> poses_;

  std::size_t next_ = 0;
};

}  // namespace gem
