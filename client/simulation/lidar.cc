#include "client/simulation/lidar.h"

#include <cmath>
#include <numbers>

#include "client/simulation/random.h"
#include "client/simulation/ray_caster.h"
#include "core/base/check.h"

namespace gem {

Lidar::Lidar(const LidarOptions& options) : options_(options) {
  GEM_CHECK(options.rings >= 1 && options.azimuths >= 1);
  constexpr double kRadPerDeg = std::numbers::pi / 180.0;
  const double spacing_deg =
      options.rings == 1
          ? 0.0
          : (options.elevation_deg_max - options.elevation_deg_min) / (options.rings - 1);
  for (int column = 0; column < options.azimuths; ++column) {
    const double azimuth_rad =
        -std::numbers::pi + 2.0 * std::numbers::pi * column / options.azimuths;
    for (int ring = 0; ring < options.rings; ++ring) {
      const double elevation_rad = (options.elevation_deg_max - ring * spacing_deg) * kRadPerDeg;
      beams_S_.emplace_back(std::cos(elevation_rad) * std::cos(azimuth_rad),
                            std::cos(elevation_rad) * std::sin(azimuth_rad),
                            std::sin(elevation_rad));
    }
  }
}

// Where the beam really points, beside where it is believed to.
Eigen::Vector3d Lidar::AcrossBeam(const Eigen::Vector3d& beam_S, double range_m,
                                  Random& random) const {
  const double sigma_m = options_.sigma_lateral_m + options_.sigma_lateral_per_m * range_m;
  const Eigen::Vector3d left = beam_S.unitOrthogonal();
  const Eigen::Vector3d up = beam_S.cross(left);
  const double left_m = sigma_m * random.Gaussian();
  return left_m * left + sigma_m * random.Gaussian() * up;
}

void Lidar::Scan(const World& world, const Pose<Global, Sensor>& T_G_S, double time_s,
                 std::uint64_t seed, std::uint64_t scan, std::vector<ScanPoint>& points) const {
  points.clear();
  Random random(seed, scan);
  const RayCaster caster(world, T_G_S.translation(), options_.range_m_max, time_s);
  const Eigen::Matrix3d R_G_S = T_G_S.matrix();
  const double sigma_across = options_.sigma_lateral_m + options_.sigma_lateral_per_m;
  for (const Eigen::Vector3d& beam_S : beams_S_) {
    // Lost before it is cast: the random numbers do not depend on what the beam would have hit.
    const bool lost = options_.dropout > 0 && random.Uniform() < options_.dropout;
    const double noise_m =
        options_.sigma_range_m > 0 ? options_.sigma_range_m * random.Gaussian() : 0;
    if (lost) continue;
    const auto hit = caster.Cast((R_G_S * beam_S).normalized());
    if (!hit) continue;
    const double range_m = hit->range_m + noise_m;
    if (range_m < options_.range_m_min || range_m > options_.range_m_max) continue;
    Eigen::Vector3d p_S = range_m * beam_S;
    if (sigma_across > 0) p_S += AcrossBeam(beam_S, hit->range_m, random);
    const Eigen::Vector3f rounded_S = p_S.cast<float>();
    points.push_back({rounded_S.x(), rounded_S.y(), rounded_S.z(), 0});
  }
}

}  // namespace gem
