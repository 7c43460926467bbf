#include "client/evaluation/town_drive.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "client/simulation/town.h"
#include "core/base/parallel_for.h"

namespace gem::evaluation {
namespace {

constexpr double kSensorHeight_m = 1.73;

}  // namespace

TownDrive BuildTownDrive(Drive drive, std::uint64_t seed) {
  std::vector<Eigen::Vector3d> way_m;
  for (const auto& T_G_B : drive.truth)
    way_m.push_back(T_G_B.translation() - Eigen::Vector3d(0, 0, kSensorHeight_m));
  TownDrive built;
  built.town = BuildTown(way_m, {.seed = seed});
  double sum2 = 0;
  for (std::size_t i = 0; i < drive.size(); ++i) {
    const Pose<Global, Base> was = drive.truth[i];
    const Eigen::Vector3d& place_m = was.translation();
    const double z_m =
        built.town->ground().HeightAt(place_m.x(), place_m.y()).value_or(way_m[i].z()) +
        kSensorHeight_m;
    drive.truth[i] = {was.rotation(), {place_m.x(), place_m.y(), z_m}};
    const Pose<Base, Base> moved = was.Inverse() * drive.truth[i];
    drive.odometry[i] = drive.odometry[i] * moved;
    drive.corrected[i] = drive.corrected[i] * moved;
    const double lift_m = z_m - place_m.z();
    sum2 += lift_m * lift_m;
    built.lift_m_max = std::max(built.lift_m_max, std::abs(lift_m));
  }
  built.lift_m_rms = std::sqrt(sum2 / static_cast<double>(std::max<std::size_t>(drive.size(), 1)));
  built.drive = std::move(drive);
  return built;
}

LidarOptions TownLidar(int azimuths) {
  LidarOptions lidar;
  lidar.azimuths = azimuths;
  lidar.range_m_max = 25;
  return lidar;
}

void CastScans(const TownDrive& drive, const CastOptions& options,
               const std::function<void(std::size_t, std::span<const ScanPoint>)>& visit) {
  constexpr std::size_t kBatch = 64;
  const Lidar lidar(options.lidar);
  const std::size_t end = options.end == 0 ? drive.drive.size() : options.end;
  std::vector<std::vector<ScanPoint>> scans(kBatch);
  for (std::size_t first = options.begin; first < end; first += kBatch) {
    const std::size_t count = std::min(kBatch, end - first);
    ParallelFor(count, options.threads, [&](std::size_t i) {
      const Pose<Global, Base>& T_G_B = drive.drive.truth[first + i];
      const Pose<Global, Sensor> T_G_S(T_G_B.rotation(), T_G_B.translation());
      lidar.Scan(*drive.town, T_G_S, 0, options.seed, first + i, scans[i]);
    });
    for (std::size_t i = 0; i < count; ++i) visit(first + i, scans[i]);
  }
}

}  // namespace gem::evaluation
