#include "client/simulation/analytic_terrain.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/base/check.h"

namespace gem {
namespace {

// max |d/du (1 - u^2)^2| = 8 / (3 sqrt(3)), at u = 1 / sqrt(3).
constexpr double kHillSlope = 1.5396007178390021;
// max |d/du (3 u^2 - 2 u^3)|, at u = 1/2.
constexpr double kStepSlope = 1.5;
// Marching never takes less: a ray along a slope would else crawl for ever.
constexpr double kStrideMin_m = 1e-3;

double SmoothStep(double u) {
  const double v = std::clamp(u, 0.0, 1.0);
  return v * v * (3.0 - 2.0 * v);
}

}  // namespace

AnalyticTerrain::AnalyticTerrain(GroundPlane plane, std::vector<Hill> hills,
                                 std::vector<Step> steps)
    : plane_(plane), hills_(std::move(hills)) {
  for (const Hill& hill : hills_) GEM_CHECK(hill.radius_m > 0);
  for (const Step& step : steps) {
    GEM_CHECK(step.width_m > 0);
    ramps_.push_back({step, {std::cos(step.yaw_rad), std::sin(step.yaw_rad)}});
  }
}

double AnalyticTerrain::Height(double x_m, double y_m) const {
  double z_m = plane_.height_m + plane_.slope_x * x_m + plane_.slope_y * y_m;
  for (const Hill& hill : hills_) {
    const double dx_m = x_m - hill.x_m;
    const double dy_m = y_m - hill.y_m;
    const double rest = 1.0 - (dx_m * dx_m + dy_m * dy_m) / (hill.radius_m * hill.radius_m);
    if (rest > 0) z_m += hill.height_m * rest * rest;
  }
  for (const Ramp& ramp : ramps_) {
    const double along_m = ramp.direction.x() * x_m + ramp.direction.y() * y_m;
    z_m +=
        ramp.step.height_m * SmoothStep((along_m - ramp.step.offset_m) / ramp.step.width_m + 0.5);
  }
  return z_m;
}

std::optional<double> AnalyticTerrain::HeightAt(double x_m, double y_m) const {
  return Height(x_m, y_m);
}

// Height of the ray over the ground.
double AnalyticTerrain::Gap(const Ray& ray, double range_m) const {
  const Eigen::Vector3d p = ray.At(range_m);
  return p.z() - Height(p.x(), p.y());
}

void AnalyticTerrain::CollectBends(const Ray& ray, double range_m_max, Bends& bends) const {
  const Eigen::Vector2d origin = ray.origin.head<2>();
  const Eigen::Vector2d direction = ray.direction.head<2>();
  const double speed2 = direction.squaredNorm();
  if (speed2 < 1e-24) return;  // straight up or down: the ground under it is one number
  const auto add = [&](double begin_m, double end_m, double slope_max) {
    begin_m = std::max(begin_m, 0.0);
    end_m = std::min(end_m, range_m_max);
    if (begin_m < end_m) bends.push_back({begin_m, end_m, slope_max});
  };
  for (const Hill& hill : hills_) {
    const Eigen::Vector2d to_center = Eigen::Vector2d(hill.x_m, hill.y_m) - origin;
    const double middle_m = to_center.dot(direction) / speed2;
    const double half2 =
        middle_m * middle_m - (to_center.squaredNorm() - hill.radius_m * hill.radius_m) / speed2;
    if (half2 <= 0) continue;
    const double half_m = std::sqrt(half2);
    add(middle_m - half_m, middle_m + half_m, kHillSlope * std::abs(hill.height_m) / hill.radius_m);
  }
  for (const Ramp& ramp : ramps_) {
    const double rate = ramp.direction.dot(direction);
    const double slope_max = kStepSlope * std::abs(ramp.step.height_m) / ramp.step.width_m;
    const double to_middle_m = ramp.step.offset_m - ramp.direction.dot(origin);
    if (std::abs(rate) < 1e-12) {  // runs along the ramp, on it or beside it
      if (std::abs(to_middle_m) <= 0.5 * ramp.step.width_m) add(0, range_m_max, slope_max);
      continue;
    }
    const double middle_m = to_middle_m / rate;
    const double half_m = 0.5 * ramp.step.width_m / std::abs(rate);
    add(middle_m - half_m, middle_m + half_m, slope_max);
  }
}

// The ray is over the ground at above_m and under it at below_m: Illinois variant of regula falsi.
double AnalyticTerrain::Refine(const Ray& ray, double above_m, double below_m) const {
  double gap_above_m = Gap(ray, above_m);
  double gap_below_m = Gap(ray, below_m);
  double range_m = above_m;
  int side = 0;
  for (int i = 0; i < 60 && below_m - above_m > 1e-12; ++i) {
    range_m = (above_m * gap_below_m - below_m * gap_above_m) / (gap_below_m - gap_above_m);
    const double gap_m = Gap(ray, range_m);
    if (std::abs(gap_m) < 1e-12) break;
    if (gap_m > 0) {
      above_m = range_m;
      gap_above_m = gap_m;
      if (side == 1) gap_below_m *= 0.5;
      side = 1;
    } else {
      below_m = range_m;
      gap_below_m = gap_m;
      if (side == -1) gap_above_m *= 0.5;
      side = -1;
    }
  }
  return range_m;
}

// Between begin_m and end_m the ground differs from the plane by at most slope_max metres a metre.
std::optional<double> AnalyticTerrain::March(const Ray& ray, double begin_m, double end_m,
                                             double slope_max) const {
  const double horizontal = ray.direction.head<2>().norm();
  const double sinking =
      plane_.slope_x * ray.direction.x() + plane_.slope_y * ray.direction.y() - ray.direction.z();
  // The gap shrinks by at most this much a metre of ray; exact where the ground is the plane.
  const double closing = sinking + slope_max * horizontal;
  double range_m = begin_m;
  double gap_m = Gap(ray, range_m);
  if (gap_m <= 0) return range_m;
  if (closing <= 0) return std::nullopt;
  while (range_m < end_m) {
    const double stride_m = std::max(gap_m / closing, kStrideMin_m);
    if (slope_max == 0) {
      if (range_m + stride_m > end_m) return std::nullopt;
      return range_m + gap_m / closing;
    }
    const double next_m = std::min(range_m + stride_m, end_m);
    const double next_gap_m = Gap(ray, next_m);
    if (next_gap_m <= 0) return Refine(ray, range_m, next_m);
    range_m = next_m;
    gap_m = next_gap_m;
  }
  return std::nullopt;
}

std::optional<double> AnalyticTerrain::Cast(const Ray& ray, double range_m_max) const {
  if (Gap(ray, 0) <= 0) return 0.0;
  // One buffer a thread: a scan casts a hundred thousand rays.
  thread_local Bends bends;
  thread_local std::vector<double> borders_m;
  bends.clear();
  CollectBends(ray, range_m_max, bends);
  if (bends.empty()) return March(ray, 0, range_m_max, 0);
  borders_m.assign({0.0, range_m_max});
  for (const Bend& bend : bends) {
    borders_m.push_back(bend.begin_m);
    borders_m.push_back(bend.end_m);
  }
  std::sort(borders_m.begin(), borders_m.end());
  for (std::size_t i = 0; i + 1 < borders_m.size(); ++i) {
    const double begin_m = borders_m[i];
    const double end_m = borders_m[i + 1];
    if (begin_m >= end_m) continue;
    double slope_max = 0;
    for (const Bend& bend : bends) {
      if (bend.begin_m <= begin_m && end_m <= bend.end_m) slope_max += bend.slope_max;
    }
    if (const auto range_m = March(ray, begin_m, end_m, slope_max)) return range_m;
  }
  return std::nullopt;
}

}  // namespace gem
