// What motion compensation is for: a spinning LiDAR on a robot that drives at 10 m/s and turns at
// 1 rad/s over rolling ground makes nearly as good a map as one that stands still for each sweep.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <memory>
#include <numbers>
#include <random>
#include <string>

#include "core/local/local_mapper.h"
#include "core/sensor/deskew.h"
#include "tests/core/local/scenes.h"

namespace gem {
namespace {

constexpr double kSpeed_m_per_s = 10;
constexpr double kYawRate_rad_per_s = 1;
constexpr double kSensor_m = 1.8;  ///< over the base, which drives on the plane z = 0
constexpr std::int64_t kSweep_ns = 100'000'000;
constexpr std::int64_t kPosePeriod_ns = 10'000'000;
constexpr int kNumSweeps = 12;

/// Waves of 0.6 m from top to bottom and 8 to 10 m of length: slopes up to 0.3.
double Ground_m(double x_m, double y_m) { return 0.3 * std::sin(0.75 * x_m) * std::cos(0.6 * y_m); }

/// On a circle of 10 m.
Pose<Odom, Base> Driven(std::int64_t stamp_ns) {
  const double t_s = static_cast<double>(stamp_ns) * 1e-9;
  const double radius_m = kSpeed_m_per_s / kYawRate_rad_per_s;
  const double yaw_rad = kYawRate_rad_per_s * t_s;
  return Pose<Odom, Base>::FromYaw(
      yaw_rad, {radius_m * std::sin(yaw_rad), radius_m - radius_m * std::cos(yaw_rad), 0});
}

/// Where the ray meets the ground, or a negative number: steps of 0.1 m, then halving.
double Cast_m(const Eigen::Vector3d& from, const Eigen::Vector3d& direction, double range_m_max) {
  const auto above_m = [&](double distance_m) {
    const Eigen::Vector3d at = from + distance_m * direction;
    return at.z() - Ground_m(at.x(), at.y());
  };
  double free_m = 0;
  while (free_m < range_m_max && above_m(free_m + 0.1) > 0) free_m += 0.1;
  if (free_m >= range_m_max) return -1;
  double hit_m = free_m + 0.1;
  for (int i = 0; i < 25; ++i) {
    const double middle_m = (free_m + hit_m) / 2;
    (above_m(middle_m) > 0 ? free_m : hit_m) = middle_m;
  }
  return hit_m;
}

struct Sweep {
  std::vector<ScanPoint> points;  ///< in S of their own time
  std::vector<float> offsets_s;   ///< to the middle of the sweep
};

/// One turn about `stamp_ns`, from half a turn before to half a turn after. A robot that stands
/// still for it has one pose.
Sweep Turn(std::int64_t stamp_ns, bool stands_still, const Pose<Base, Sensor>& T_B_S,
           std::mt19937& random) {
  constexpr int kColumns = 900, kRings = 32;
  std::normal_distribution<double> noise_m(0, LidarNoise().sigma_axial_m);
  Sweep sweep;
  for (int column = 0; column < kColumns; ++column) {
    const double turned = (column + 0.37) / kColumns - 0.5;
    const auto offset_ns = static_cast<std::int64_t>(turned * static_cast<double>(kSweep_ns));
    const Pose<Odom, Sensor> T_O_S = Driven(stamp_ns + (stands_still ? 0 : offset_ns)) * T_B_S;
    const Eigen::Matrix3d R_OS = T_O_S.matrix();
    const double azimuth_rad = 2 * std::numbers::pi * turned;
    for (int ring = 0; ring < kRings; ++ring) {
      const double elevation_rad = -0.45 + 0.4 * ring / kRings;
      const Eigen::Vector3d beam_S(std::cos(elevation_rad) * std::cos(azimuth_rad),
                                   std::cos(elevation_rad) * std::sin(azimuth_rad),
                                   std::sin(elevation_rad));
      double distance_m = Cast_m(T_O_S.translation(), R_OS * beam_S, 20);
      if (distance_m < 0) continue;
      distance_m += noise_m(random);
      const Eigen::Vector3f p_S = (distance_m * beam_S).cast<float>();
      sweep.points.push_back({p_S.x(), p_S.y(), p_S.z(), 0});
      sweep.offsets_s.push_back(static_cast<float>(static_cast<double>(offset_ns) * 1e-9));
    }
  }
  return sweep;
}

enum class Sensing { kStandingStill, kDeskewed, kAsItComes };

/// Root of the mean squared height error of all known cells after the last sweep, metres.
double HeightError_m(Sensing sensing) {
  LocalMapOptions options;
  options.side_m = 20;
  const std::unique_ptr<LocalMapper> mapper = *MakeLocalMapper(LocalBackend::kCpu, options);
  const auto T_B_S = Pose<Base, Sensor>::FromTranslation(0.3, 0, kSensor_m);
  Trajectory<Odom, Base> odometry;
  for (std::int64_t t = 0; t <= (kNumSweeps + 1) * kSweep_ns; t += kPosePeriod_ns)
    odometry.Append(t, Driven(t));
  std::mt19937 random(20261122);
  std::vector<EvictedCell> evicted;
  for (int i = 1; i <= kNumSweeps; ++i) {
    Scan scan;
    scan.seq = static_cast<std::uint64_t>(i);
    scan.stamp_ns = i * kSweep_ns;
    scan.T_O_B = Driven(scan.stamp_ns);
    scan.T_B_S = T_B_S;
    scan.noise = testing::LidarNoiseModel();
    Sweep sweep = Turn(scan.stamp_ns, sensing == Sensing::kStandingStill, T_B_S, random);
    if (sensing == Sensing::kDeskewed)
      Deskew(odometry, scan.stamp_ns, T_B_S, sweep.offsets_s, sweep.points);
    scan.points = sweep.points;
    mapper->FuseScan(scan, evicted);
  }
  evicted.clear();
  mapper->EvictAll(evicted);
  double sum_m2 = 0;
  for (const EvictedCell& cell : evicted) {
    const double truth_m = Ground_m(CenterOf(cell.cell.x, options.cell_size_m),
                                    CenterOf(cell.cell.y, options.cell_size_m));
    sum_m2 += std::pow(cell.belief.elevation_m - truth_m, 2);
  }
  EXPECT_GT(evicted.size(), 5000u);
  return std::sqrt(sum_m2 / static_cast<double>(evicted.size()));
}

TEST(MovingSweep, IsNearlyAsGoodAsStandingStillOnceItIsDeskewed) {
  const double still_m = HeightError_m(Sensing::kStandingStill);
  const double deskewed_m = HeightError_m(Sensing::kDeskewed);
  const double as_it_comes_m = HeightError_m(Sensing::kAsItComes);
  std::printf(
      "height error: %.1f mm standing still, %.1f mm deskewed (%.2f times), "
      "%.1f mm as it comes (%.2f times)\n",
      1e3 * still_m, 1e3 * deskewed_m, deskewed_m / still_m, 1e3 * as_it_comes_m,
      as_it_comes_m / still_m);
  RecordProperty("still_mm", std::to_string(1e3 * still_m));
  RecordProperty("deskewed_mm", std::to_string(1e3 * deskewed_m));
  RecordProperty("as_it_comes_mm", std::to_string(1e3 * as_it_comes_m));
  EXPECT_LT(deskewed_m, 1.2 * still_m);
  EXPECT_GT(as_it_comes_m, 2 * deskewed_m);
}

}  // namespace
}  // namespace gem
