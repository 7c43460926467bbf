// The ground of a simulated world: one height over every place, in G. Trees, houses and walkers
// stand on it and are no part of it.
#pragma once

#include <Eigen/Core>
#include <optional>

namespace gem {

/// A straight line through the world, in G. `direction` is a unit vector.
struct Ray {
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();  ///< metres
  Eigen::Vector3d direction = Eigen::Vector3d::UnitX();

  Eigen::Vector3d At(double range_m) const { return origin + range_m * direction; }
};

/// Immutable, so any number of threads may ask.
class HeightField {
 public:
  virtual ~HeightField() = default;

  /// Metres over z = 0 of G; nothing where the ground is not known.
  virtual std::optional<double> HeightAt(double x_m, double y_m) const = 0;

  /// Range at which the ray first meets the ground in [0, range_m_max]; nothing if it does not.
  /// The hit is on the surface to 1e-9 m times the steepness; bumps that the ray enters for less
  /// than a millimetre may be missed.
  virtual std::optional<double> Cast(const Ray& ray, double range_m_max) const = 0;
};

}  // namespace gem
