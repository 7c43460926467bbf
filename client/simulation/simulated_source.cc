#include "client/simulation/simulated_source.h"

#include <cmath>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/str_format.h"
#include "core/base/check.h"
#include "core/base/status_macros.h"

namespace gem {
namespace {

// Not zero: a stamp of zero is what an unset field looks like.
constexpr std::int64_t kFirstStamp_ns = 1'000'000'000;
// Half the base of a small car: the ground's slope is taken over this much to either side.
constexpr double kWheelbaseHalf_m = 0.5;

Eigen::Vector3d GroundNormal(const HeightField& ground, const Eigen::Vector2d& place_m) {
  const auto slope = [&](const Eigen::Vector2d& reach_m) {
    const Eigen::Vector2d ahead_m = place_m + reach_m;
    const Eigen::Vector2d behind_m = place_m - reach_m;
    const auto ahead = ground.HeightAt(ahead_m.x(), ahead_m.y());
    const auto behind = ground.HeightAt(behind_m.x(), behind_m.y());
    // Level at the edge of the known ground.
    return ahead && behind ? (*ahead - *behind) / (2 * kWheelbaseHalf_m) : 0.0;
  };
  return Eigen::Vector3d(-slope({kWheelbaseHalf_m, 0}), -slope({0, kWheelbaseHalf_m}), 1)
      .normalized();
}

absl::StatusOr<Pose<Global, Base>> TruePose(const Simulation& simulation, double way_m) {
  const PathPose on_path = simulation.path.At(way_m);
  const Eigen::Vector2d& place_m = on_path.place_m;
  const HeightField& ground = simulation.world->ground();
  const auto height_m = ground.HeightAt(place_m.x(), place_m.y());
  if (!height_m) {
    return absl::FailedPreconditionError(
        absl::StrFormat("scene %s: no ground under the robot at x %.2f m, y %.2f m",
                        simulation.name, place_m.x(), place_m.y()));
  }
  Eigen::Quaterniond rotation(Eigen::AngleAxisd(on_path.yaw_rad, Eigen::Vector3d::UnitZ()));
  if (simulation.robot.leans) {
    rotation = Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(),
                                                  GroundNormal(ground, place_m)) *
               rotation;
  }
  return Pose<Global, Base>(rotation.normalized(), {place_m.x(), place_m.y(), *height_m});
}

bool Silent(const Simulation& simulation, double way_m) {
  for (const SilentStretch& silence : simulation.silences) {
    if (way_m >= silence.begin_m && way_m < silence.end_m) return true;
  }
  return false;
}

}  // namespace

absl::StatusOr<std::unique_ptr<SimulatedSource>> SimulatedSource::Make(Simulation simulation) {
  GEM_CHECK(simulation.world != nullptr && simulation.robot.scan_period_s >= 1e-6);
  GEM_CHECK(simulation.robot.scan_spacing_m >= 0);
  GEM_ASSIGN_OR_RETURN(const NoiseModel noise, MakeNoiseModel(LidarNoise{}));
  const std::int64_t period_ns = std::llround(simulation.robot.scan_period_s * 1e9);
  Odometry odometry(simulation.drift, simulation.jumps, simulation.seed);
  std::vector<SimulatedPose> poses;
  for (std::size_t step = 0; step < simulation.num_steps; ++step) {
    const double way_m = static_cast<double>(step) * simulation.robot.scan_spacing_m;
    GEM_ASSIGN_OR_RETURN(const auto T_G_B, TruePose(simulation, way_m));
    const Pose<Odom, Base> T_O_B = odometry.Advance(way_m, T_G_B);
    if (Silent(simulation, way_m)) continue;
    const std::int64_t stamp_ns = kFirstStamp_ns + static_cast<std::int64_t>(step) * period_ns;
    poses.push_back({stamp_ns, way_m, T_G_B, T_O_B});
  }
  return std::unique_ptr<SimulatedSource>(
      new SimulatedSource(std::move(simulation), std::move(poses), noise));
}

SimulatedSource::SimulatedSource(Simulation simulation, std::vector<SimulatedPose> poses,
                                 NoiseModel noise)
    : name_(std::move(simulation.name)),
      world_(std::move(simulation.world)),
      lidar_(simulation.lidar),
      T_B_S_(Pose<Base, Sensor>::FromTranslation(0, 0, simulation.robot.sensor_height_m)),
      noise_(noise),
      seed_(simulation.seed),
      poses_(std::move(poses)) {}

double SimulatedSource::WorldTime(std::int64_t stamp_ns) {
  return static_cast<double>(stamp_ns - kFirstStamp_ns) * 1e-9;
}

absl::StatusOr<bool> SimulatedSource::Next(SourceScan& scan) {
  if (next_ == poses_.size()) return false;
  const SimulatedPose& pose = poses_[next_];
  scan.stamp_ns = pose.stamp_ns;
  scan.T_O_B = pose.T_O_B;
  scan.T_G_B = pose.T_G_B;
  lidar_.Scan(*world_, pose.T_G_B * T_B_S_, WorldTime(pose.stamp_ns), seed_, next_, scan.points);
  ++next_;
  return true;
}

}  // namespace gem
