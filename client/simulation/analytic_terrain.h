// Ground made of formulas: a tilted plane plus smooth hills and steps. Rays are cast exactly where
// it is a plane and by marching with a bound on the slope elsewhere.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "client/simulation/height_field.h"

namespace gem {

/// height * (1 - (d / radius)^2)^2 within `radius_m` of the centre, nothing beyond: smooth, and a
/// ray that passes by costs nothing. Its steepest slope is 1.54 height / radius.
struct Hill {
  double x_m = 0;
  double y_m = 0;
  double radius_m = 10;  ///< positive
  double height_m = 1;   ///< negative: a hollow
};

/// The ground rises by `height_m` across a line, over a ramp `width_m` wide whose middle is at
/// distance `offset_m` along the direction `yaw_rad` from the origin. Its steepest slope is
/// 1.5 height / width.
struct Step {
  double yaw_rad = 0;  ///< direction in which it rises
  double offset_m = 0;
  double width_m = 0.05;  ///< positive
  double height_m = 0.15;
};

/// z = height_m + slope_x x + slope_y y.
struct GroundPlane {
  double height_m = 0;
  double slope_x = 0;
  double slope_y = 0;
};

class AnalyticTerrain final : public HeightField {
 public:
  AnalyticTerrain(GroundPlane plane, std::vector<Hill> hills, std::vector<Step> steps);

  std::optional<double> HeightAt(double x_m, double y_m) const override;
  std::optional<double> Cast(const Ray& ray, double range_m_max) const override;

 private:
  struct Ramp {
    Step step;
    Eigen::Vector2d direction;
  };
  /// Part of a ray on which one hill or step may bend the ground.
  struct Bend {
    double begin_m = 0;
    double end_m = 0;
    double slope_max = 0;
  };
  using Bends = std::vector<Bend>;

  double Height(double x_m, double y_m) const;
  double Gap(const Ray& ray, double range_m) const;
  void CollectBends(const Ray& ray, double range_m_max, Bends& bends) const;
  std::optional<double> March(const Ray& ray, double begin_m, double end_m, double slope_max) const;
  double Refine(const Ray& ray, double above_m, double below_m) const;

  // Constant after construction.
  GroundPlane plane_;
  std::vector<Hill> hills_;
  std::vector<Ramp> ramps_;
};

}  // namespace gem
