#include "client/simulation/world.h"

#include <algorithm>

namespace gem {

std::optional<double> World::TrueHeightAt(double x_m, double y_m) const {
  std::optional<double> height_m = ground_->HeightAt(x_m, y_m);
  const auto raise = [&](const auto& solid) {
    if (Covers(solid, {x_m, y_m}))
      height_m = std::max(height_m.value_or(solid.z_m_max), solid.z_m_max);
  };
  for (const Box& box : boxes_) raise(box);
  for (const Cylinder& cylinder : cylinders_) raise(cylinder);
  return height_m;
}

Cylinder World::WalkerAt(std::size_t walker, double time_s) const {
  const Walker& who = walkers_[walker];
  const Eigen::Vector2d place_m = who.At(time_s);
  const double ground_m = ground_->HeightAt(place_m.x(), place_m.y()).value_or(0.0);
  return {.center_m = place_m,
          .radius_m = who.radius_m,
          .z_m_min = ground_m,
          .z_m_max = ground_m + who.height_m};
}

std::optional<Hit> World::Cast(const Ray& ray, double range_m_max, double time_s) const {
  std::optional<Hit> nearest;
  const auto offer = [&](std::optional<double> range_m, HitKind kind, std::size_t index) {
    if (range_m && (!nearest || *range_m < nearest->range_m)) nearest = Hit{*range_m, kind, index};
  };
  offer(ground_->Cast(ray, range_m_max), HitKind::kGround, 0);
  for (std::size_t i = 0; i < boxes_.size(); ++i)
    offer(gem::Cast(ray, range_m_max, boxes_[i]), HitKind::kBox, i);
  for (std::size_t i = 0; i < cylinders_.size(); ++i)
    offer(gem::Cast(ray, range_m_max, cylinders_[i]), HitKind::kCylinder, i);
  for (std::size_t i = 0; i < walkers_.size(); ++i)
    offer(gem::Cast(ray, range_m_max, WalkerAt(i, time_s)), HitKind::kWalker, i);
  return nearest;
}

}  // namespace gem
