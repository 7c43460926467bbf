// Little worlds for the tests of the local mapper: boxes on flat ground and a spinning LiDAR that
// sees them. Everything follows from fixed seeds.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <random>
#include <vector>

#include "core/sensor/scan.h"

namespace gem::testing {

/// An axis-aligned box in O, metres.
struct Box {
  Eigen::Vector3d min;
  Eigen::Vector3d max;
};
inline Box BoxOn(double x_m, double y_m, double side_m, double height_m, double ground_m = 0) {
  const double half_m = side_m / 2;
  return {{x_m - half_m, y_m - half_m, ground_m},
          {x_m + half_m, y_m + half_m, ground_m + height_m}};
}

/// Flat ground with boxes on it.
struct World {
  double ground_m = 0;
  std::vector<Box> boxes;

  /// Distance along the ray to the first hit, or a negative number.
  double Cast(const Eigen::Vector3d& from, const Eigen::Vector3d& direction) const {
    double nearest_m = -1;
    const auto offer = [&nearest_m](double distance_m) {
      if (distance_m > 0 && (nearest_m < 0 || distance_m < nearest_m)) nearest_m = distance_m;
    };
    if (direction.z() < 0) offer((ground_m - from.z()) / direction.z());
    for (const Box& box : boxes) {
      double enter_m = 0, leave_m = 1e9;
      for (int axis = 0; axis < 3; ++axis) {
        double a_m = (box.min(axis) - from(axis)) / direction(axis);
        double b_m = (box.max(axis) - from(axis)) / direction(axis);
        if (a_m > b_m) std::swap(a_m, b_m);
        enter_m = std::max(enter_m, a_m);
        leave_m = std::min(leave_m, b_m);
      }
      if (enter_m < leave_m) offer(enter_m);
    }
    return nearest_m;
  }
};

/// A 64-ring LiDAR.
struct Lidar {
  int rings = 64;
  int columns = 1800;
  double elevation_rad_min = -0.43;
  double elevation_rad_max = 0.035;
  double range_m_max = 60;
  double sigma_m = 0;  ///< along the beam

  std::vector<ScanPoint> Sweep(const World& world, const Pose<Odom, Sensor>& T_O_S,
                               std::mt19937& random) const {
    std::normal_distribution<double> noise_m(0, 1);
    std::vector<ScanPoint> points;
    const Eigen::Matrix3d R_OS = T_O_S.matrix();
    for (int column = 0; column < columns; ++column) {
      // Off by a fraction of a column, so that no ray runs along an axis to the last bit.
      const double azimuth_rad = 2 * std::numbers::pi * (column + 0.37) / columns;
      for (int ring = 0; ring < rings; ++ring) {
        const double elevation_rad = elevation_rad_min + (elevation_rad_max - elevation_rad_min) *
                                                             ring / std::max(rings - 1, 1);
        const Eigen::Vector3d beam_S(std::cos(elevation_rad) * std::cos(azimuth_rad),
                                     std::cos(elevation_rad) * std::sin(azimuth_rad),
                                     std::sin(elevation_rad));
        double distance_m = world.Cast(T_O_S.translation(), R_OS * beam_S);
        if (distance_m < 0 || distance_m > range_m_max) continue;
        distance_m += sigma_m * noise_m(random);
        const Eigen::Vector3f p_S = (distance_m * beam_S).cast<float>();
        points.push_back({p_S.x(), p_S.y(), p_S.z(), 0});
      }
    }
    return points;
  }
};

inline NoiseModel LidarNoiseModel() { return *MakeNoiseModel(LidarNoise()); }

/// Points in O for a robot that stands at the origin of O with the sensor at sensor_z_m over it.
class PointScan {
 public:
  explicit PointScan(double sensor_z_m = 1.0)
      : PointScan(Pose<Odom, Base>(), Pose<Base, Sensor>::FromTranslation(0, 0, sensor_z_m)) {}
  PointScan(const Pose<Odom, Base>& T_O_B, const Pose<Base, Sensor>& T_B_S) {
    scan_.T_O_B = T_O_B;
    scan_.T_B_S = T_B_S;
    // The same error in every direction: variances come out round.
    scan_.noise = {.along_beam = true, .axial_m = {0.1f, 0, 0}, .lateral_m = {0.1f, 0}};
  }

  PointScan& Add(double x_m, double y_m, double z_m, Rgba rgba = 0) {
    const Point<Sensor> p_S = (scan_.T_O_B * scan_.T_B_S).Inverse() * Point<Odom>(x_m, y_m, z_m);
    const Eigen::Vector3f xyz = p_S.xyz().cast<float>();
    points_.push_back({xyz.x(), xyz.y(), xyz.z(), rgba});
    return *this;
  }
  PointScan& AddAll(const std::vector<ScanPoint>& points_S) {
    points_.insert(points_.end(), points_S.begin(), points_S.end());
    return *this;
  }
  /// One point in the middle of each cell of [min, max) whose centre satisfies the condition.
  template <typename HeightOf>
  PointScan& AddCells(CellRect cells, double cell_size_m, HeightOf height_of) {
    for (std::int32_t y = cells.min.y; y < cells.max.y; ++y) {
      for (std::int32_t x = cells.min.x; x < cells.max.x; ++x) {
        const double x_m = CenterOf(x, cell_size_m), y_m = CenterOf(y, cell_size_m);
        Add(x_m, y_m, height_of(x_m, y_m));
      }
    }
    return *this;
  }

  /// Scan number `seq`, taken seq tenths of a second after zero. Valid while this object lives.
  const Scan& At(std::uint64_t seq) {
    scan_.seq = seq;
    scan_.stamp_ns = static_cast<std::int64_t>(seq) * 100'000'000;
    scan_.points = points_;
    return scan_;
  }
  Scan& scan() { return scan_; }

 private:
  Scan scan_;
  std::vector<ScanPoint> points_;
};

}  // namespace gem::testing
