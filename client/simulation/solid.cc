#include "client/simulation/solid.h"

#include <algorithm>

#include "core/base/check.h"

namespace gem {
namespace {

/// The part of a ray that is inside everything it was clipped to; empty: begin > end.
struct Inside {
  double begin_m = 0;
  double end_m = 0;

  void ClipToSlab(double origin, double direction, double low, double high) {
    // A ray along the slab divides by zero: it is inside for ever or never.
    if (direction == 0) {
      if (origin < low || origin > high) end_m = -1;
      return;
    }
    const double a = (low - origin) / direction;
    const double b = (high - origin) / direction;
    begin_m = std::max(begin_m, std::min(a, b));
    end_m = std::min(end_m, std::max(a, b));
  }

  std::optional<double> Entry() const {
    return begin_m <= end_m ? std::optional(begin_m) : std::nullopt;
  }
};

/// v in the axes of the box.
Eigen::Vector2d InAxesOf(const Box& box, const Eigen::Vector2d& v) {
  return {box.x_axis.x() * v.x() + box.x_axis.y() * v.y(),
          -box.x_axis.y() * v.x() + box.x_axis.x() * v.y()};
}

}  // namespace

Box MakeBox(const Eigen::Vector2d& center_m, const Eigen::Vector2d& size_m, double yaw_rad,
            double z_m_min, double z_m_max) {
  return {.center_m = center_m,
          .size_m = size_m,
          .x_axis = {std::cos(yaw_rad), std::sin(yaw_rad)},
          .z_m_min = z_m_min,
          .z_m_max = z_m_max};
}

Box MakeWall(const Eigen::Vector2d& from_m, const Eigen::Vector2d& to_m, double thickness_m,
             double z_m_min, double z_m_max) {
  const Eigen::Vector2d along = to_m - from_m;
  return {.center_m = 0.5 * (from_m + to_m),
          .size_m = {along.norm(), thickness_m},
          .x_axis = along.normalized(),
          .z_m_min = z_m_min,
          .z_m_max = z_m_max};
}

Eigen::Vector2d Walker::At(double time_s) const {
  GEM_CHECK(!path_m.empty());
  double length_m = 0;
  for (std::size_t i = 1; i < path_m.size(); ++i) length_m += (path_m[i] - path_m[i - 1]).norm();
  if (length_m == 0) return path_m.front();
  double rest_m = std::fmod(start_m + speed_m_per_s * time_s, 2 * length_m);
  if (rest_m > length_m) rest_m = 2 * length_m - rest_m;  // on his way back
  for (std::size_t i = 1; i < path_m.size(); ++i) {
    const double leg_m = (path_m[i] - path_m[i - 1]).norm();
    if (rest_m <= leg_m && leg_m > 0)
      return path_m[i - 1] + rest_m / leg_m * (path_m[i] - path_m[i - 1]);
    rest_m -= leg_m;
  }
  return path_m.back();
}

std::optional<double> Cast(const Ray& ray, double range_m_max, const Box& box) {
  const Eigen::Vector2d origin = InAxesOf(box, ray.origin.head<2>() - box.center_m);
  const Eigen::Vector2d direction = InAxesOf(box, ray.direction.head<2>());
  const Eigen::Vector2d half_m = 0.5 * box.size_m;
  Inside inside{0, range_m_max};
  inside.ClipToSlab(origin.x(), direction.x(), -half_m.x(), half_m.x());
  inside.ClipToSlab(origin.y(), direction.y(), -half_m.y(), half_m.y());
  inside.ClipToSlab(ray.origin.z(), ray.direction.z(), box.z_m_min, box.z_m_max);
  return inside.Entry();
}

std::optional<double> Cast(const Ray& ray, double range_m_max, const Cylinder& cylinder) {
  const Eigen::Vector2d origin = ray.origin.head<2>() - cylinder.center_m;
  const Eigen::Vector2d direction = ray.direction.head<2>();
  Inside inside{0, range_m_max};
  inside.ClipToSlab(ray.origin.z(), ray.direction.z(), cylinder.z_m_min, cylinder.z_m_max);
  const double a = direction.squaredNorm();
  const double c = origin.squaredNorm() - cylinder.radius_m * cylinder.radius_m;
  if (a == 0) return c <= 0 ? inside.Entry() : std::nullopt;
  const double b = origin.dot(direction);
  const double discriminant = b * b - a * c;
  if (discriminant < 0) return std::nullopt;
  const double root = std::sqrt(discriminant);
  inside.begin_m = std::max(inside.begin_m, (-b - root) / a);
  inside.end_m = std::min(inside.end_m, (-b + root) / a);
  return inside.Entry();
}

bool Covers(const Box& box, const Eigen::Vector2d& place_m) {
  const Eigen::Vector2d p = InAxesOf(box, place_m - box.center_m).cwiseAbs();
  return p.x() <= 0.5 * box.size_m.x() && p.y() <= 0.5 * box.size_m.y();
}

bool Covers(const Cylinder& cylinder, const Eigen::Vector2d& place_m) {
  return (place_m - cylinder.center_m).norm() <= cylinder.radius_m;
}

}  // namespace gem
