// A spinning LiDAR: rings of beams, Gaussian noise along the beam, lost beams. A scan is taken in
// an instant: the robot does not move while it turns.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "client/simulation/random.h"
#include "client/simulation/world.h"
#include "core/geometry/pose.h"
#include "core/sensor/scan.h"

namespace gem {

struct LidarOptions {
  int rings = 64;
  int azimuths = 1024;
  /// Of the highest and the lowest ring; an HDL-64's.
  double elevation_deg_max = 2.0;
  double elevation_deg_min = -24.8;
  /// Nothing nearer or farther is seen, metres.
  double range_m_min = 0.9;
  double range_m_max = 80.0;
  /// Of the range, metres.
  double sigma_range_m = 0.018;
  /// Across the beam, in both directions: at the sensor, and for each metre of range. The scenes do
  /// without.
  double sigma_lateral_m = 0;
  double sigma_lateral_per_m = 0;
  /// Share of beams that come back with nothing.
  double dropout = 0.01;
};

/// Immutable, so any number of threads may scan.
class Lidar {
 public:
  /// The caller has checked the options: at least one ring and one azimuth.
  explicit Lidar(const LidarOptions& options);

  const LidarOptions& options() const { return options_; }

  /// Points in S, one turn anticlockwise from behind, each column from the highest ring to the
  /// lowest. `scan` and `seed` choose the noise.
  void Scan(const World& world, const Pose<Global, Sensor>& T_G_S, double time_s,
            std::uint64_t seed, std::uint64_t scan, std::vector<ScanPoint>& points) const;

 private:
  Eigen::Vector3d AcrossBeam(const Eigen::Vector3d& beam_S, double range_m, Random& random) const;

  // Constant after construction.
  LidarOptions options_;
  std::vector<Eigen::Vector3d> beams_S_;  ///< unit vectors, a column after the other
};

}  // namespace gem
