// What stands or walks in a simulated world: upright boxes and cylinders. Rays hit them exactly.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <optional>
#include <vector>

#include "client/simulation/height_field.h"

namespace gem {

/// A box that stands upright.
struct Box {
  Eigen::Vector2d center_m = Eigen::Vector2d::Zero();
  Eigen::Vector2d size_m = Eigen::Vector2d::Ones();   ///< along its own x and y
  Eigen::Vector2d x_axis = Eigen::Vector2d::UnitX();  ///< its own x, a unit vector
  double z_m_min = 0;
  double z_m_max = 1;
};

/// A box turned by yaw_rad about its vertical axis.
Box MakeBox(const Eigen::Vector2d& center_m, const Eigen::Vector2d& size_m, double yaw_rad,
            double z_m_min, double z_m_max);

/// A wall from one place to another: a box.
Box MakeWall(const Eigen::Vector2d& from_m, const Eigen::Vector2d& to_m, double thickness_m,
             double z_m_min, double z_m_max);

/// A cylinder that stands upright.
struct Cylinder {
  Eigen::Vector2d center_m = Eigen::Vector2d::Zero();
  double radius_m = 0.3;
  double z_m_min = 0;
  double z_m_max = 1.7;
};

/// A person: an upright cylinder that walks along a polyline, over and over from its first point to
/// its last and back, standing on the ground of the world.
struct Walker {
  std::vector<Eigen::Vector2d> path_m;  ///< at least one point; one: he stands
  double speed_m_per_s = 1.4;
  double radius_m = 0.3;
  double height_m = 1.7;
  double start_m = 0;  ///< how far along the path he is at time 0

  Eigen::Vector2d At(double time_s) const;
};

/// Range in [0, range_m_max] at which the ray enters the solid; 0 from inside.
std::optional<double> Cast(const Ray& ray, double range_m_max, const Box& box);
std::optional<double> Cast(const Ray& ray, double range_m_max, const Cylinder& cylinder);

/// Whether the solid stands over the place.
bool Covers(const Box& box, const Eigen::Vector2d& place_m);
bool Covers(const Cylinder& cylinder, const Eigen::Vector2d& place_m);

inline double BoundingRadius(const Box& box) { return 0.5 * box.size_m.norm(); }
inline double BoundingRadius(const Cylinder& cylinder) { return cylinder.radius_m; }

}  // namespace gem
