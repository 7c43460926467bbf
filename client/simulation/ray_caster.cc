#include "client/simulation/ray_caster.h"

#include <algorithm>
#include <cmath>

namespace gem {
namespace {

/// Grows with the azimuth like an angle, from 0 to 4, at the price of a division.
double DiamondAngle(double x, double y) {
  const double sum = std::abs(x) + std::abs(y);
  if (sum == 0) return 0;  // straight up or down
  const double t = y / sum;
  if (x < 0) return 2 - t;
  return t < 0 ? 4 + t : t;
}

constexpr int kSectors = 1024;

int SectorOf(double x, double y) {
  return std::min(static_cast<int>(DiamondAngle(x, y) * (kSectors / 4)), kSectors - 1);
}

}  // namespace

template <typename Solid>
void RayCaster::Consider(HitKind kind, std::size_t index, const Solid& solid) {
  const double radius_m = BoundingRadius(solid);
  const double distance_m = (solid.center_m - origin_m_.head<2>()).norm() - radius_m;
  if (distance_m > range_m_max_) return;
  candidates_.push_back({kind, index, solid.center_m, radius_m, distance_m});
}

RayCaster::RayCaster(const World& world, const Eigen::Vector3d& origin_m, double range_m_max,
                     double time_s)
    : world_(world), origin_m_(origin_m), range_m_max_(range_m_max), sectors_(kSectors) {
  for (std::size_t i = 0; i < world.walkers().size(); ++i)
    bodies_.push_back(world.WalkerAt(i, time_s));
  for (std::size_t i = 0; i < world.boxes().size(); ++i)
    Consider(HitKind::kBox, i, world.boxes()[i]);
  for (std::size_t i = 0; i < world.cylinders().size(); ++i)
    Consider(HitKind::kCylinder, i, world.cylinders()[i]);
  for (std::size_t i = 0; i < bodies_.size(); ++i) Consider(HitKind::kWalker, i, bodies_[i]);
  std::stable_sort(
      candidates_.begin(), candidates_.end(),
      [](const Candidate& a, const Candidate& b) { return a.distance_m_min < b.distance_m_min; });
  for (std::uint32_t c = 0; c < candidates_.size(); ++c) Enlist(c);
}

// Writes the candidate into every sector that its bounding circle touches.
void RayCaster::Enlist(std::uint32_t candidate) {
  const Candidate& c = candidates_[candidate];
  int first = 0;
  int count = kSectors;
  if (c.distance_m_min > 0) {
    const Eigen::Vector2d to = c.center_m - origin_m_.head<2>();
    const double middle_rad = std::atan2(to.y(), to.x());
    const double half_rad = std::asin(c.radius_m / to.norm());
    const int begin = SectorOf(std::cos(middle_rad - half_rad), std::sin(middle_rad - half_rad));
    const int end = SectorOf(std::cos(middle_rad + half_rad), std::sin(middle_rad + half_rad));
    // One more on either side: the borders are rounded.
    first = begin - 1;
    count = (end - begin + kSectors) % kSectors + 3;
  }
  for (int i = 0; i < std::min(count, kSectors); ++i)
    sectors_[static_cast<std::size_t>((first + i + kSectors) % kSectors)].push_back(candidate);
}

std::optional<double> RayCaster::CastAt(const Candidate& candidate, const Ray& ray,
                                        double range_m_max) const {
  switch (candidate.kind) {
    case HitKind::kBox:
      return gem::Cast(ray, range_m_max, world_.boxes()[candidate.index]);
    case HitKind::kCylinder:
      return gem::Cast(ray, range_m_max, world_.cylinders()[candidate.index]);
    case HitKind::kWalker:
      return gem::Cast(ray, range_m_max, bodies_[candidate.index]);
    case HitKind::kGround:
      break;
  }
  return std::nullopt;
}

std::optional<Hit> RayCaster::Cast(const Eigen::Vector3d& direction) const {
  const Ray ray{origin_m_, direction};
  const double horizontal = direction.head<2>().norm();
  std::optional<Hit> nearest;
  double range_m_max = range_m_max_;
  for (const std::uint32_t i : sectors_[SectorOf(direction.x(), direction.y())]) {
    const Candidate& candidate = candidates_[i];
    if (candidate.distance_m_min > range_m_max * horizontal) break;
    if (const auto range_m = CastAt(candidate, ray, range_m_max);
        range_m && (!nearest || *range_m < nearest->range_m)) {
      nearest = Hit{*range_m, candidate.kind, candidate.index};
      range_m_max = *range_m;
    }
  }
  // The ground last: a near wall leaves little of the ray to march along.
  if (const auto range_m = world_.ground().Cast(ray, range_m_max);
      range_m && (!nearest || *range_m <= nearest->range_m)) {
    nearest = Hit{*range_m, HitKind::kGround, 0};
  }
  return nearest;
}

}  // namespace gem
