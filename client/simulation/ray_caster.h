// Casts many rays from one place at one time, as a scan does: the solids are sorted by direction
// and distance first, so that a ray asks only those that it can hit. Agrees with World::Cast.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "client/simulation/world.h"

namespace gem {

/// Holds the world by reference: it must outlive the caster.
class RayCaster {
 public:
  RayCaster(const World& world, const Eigen::Vector3d& origin_m, double range_m_max, double time_s);

  /// First thing along the unit vector `direction`, within range_m_max.
  std::optional<Hit> Cast(const Eigen::Vector3d& direction) const;

 private:
  struct Candidate {
    HitKind kind = HitKind::kBox;
    std::size_t index = 0;
    Eigen::Vector2d center_m;  ///< of its bounding circle
    double radius_m = 0;
    double distance_m_min = 0;  ///< horizontal, to the circle: no hit is nearer
  };

  template <typename Solid>
  void Consider(HitKind kind, std::size_t index, const Solid& solid);
  void Enlist(std::uint32_t candidate);
  std::optional<double> CastAt(const Candidate& candidate, const Ray& ray,
                               double range_m_max) const;

  // Constant after construction.
  const World& world_;
  const Eigen::Vector3d origin_m_;
  const double range_m_max_;
  std::vector<Cylinder> bodies_;       ///< of the walkers, at this time
  std::vector<Candidate> candidates_;  ///< nearest first
  /// By direction: into candidates_, nearest first.
  std::vector<std::vector<std::uint32_t>> sectors_;
};

}  // namespace gem
