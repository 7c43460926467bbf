#include "client/camera/project_colors.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

namespace gem {
namespace {

// Nearer to the plane of the camera nothing is in focus, and the quotient grows without bound.
constexpr double kDepthMin_m = 0.01;

/// Where a point falls.
struct Projected {
  std::size_t point = 0;
  std::int32_t u = 0, v = 0;
  double depth_m = 0;
};

std::vector<Projected> Project(std::span<const ScanPoint> points, const Image& image,
                               const CameraModel& camera, const Pose<Camera, Sensor>& T_C_S) {
  const Eigen::Matrix3d rotation = T_C_S.matrix();
  std::vector<Projected> seen;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector3d p_S(points[i].x_m, points[i].y_m, points[i].z_m);
    const Eigen::Vector3d p_C = rotation * p_S + T_C_S.translation();
    if (!(p_C.z() >= kDepthMin_m)) continue;
    const double u = std::round(camera.fx_px * p_C.x() / p_C.z() + camera.cx_px);
    const double v = std::round(camera.fy_px * p_C.y() / p_C.z() + camera.cy_px);
    // Compared as doubles: far outside they do not fit an integer.
    if (!(u >= 0 && v >= 0 && u < image.width && v < image.height)) continue;
    seen.push_back({i, static_cast<std::int32_t>(u), static_cast<std::int32_t>(v), p_C.z()});
  }
  return seen;
}

}  // namespace

std::size_t ProjectColors(std::span<ScanPoint> points, const Image& image,
                          const CameraModel& camera, const Pose<Camera, Sensor>& T_C_S,
                          const ColorProjectionOptions& options) {
  const std::vector<Projected> seen = Project(points, image, camera, T_C_S);
  const std::int32_t columns = (image.width + options.block_px - 1) / options.block_px;
  const std::int32_t rows = (image.height + options.block_px - 1) / options.block_px;
  std::vector<double> nearest_m(static_cast<std::size_t>(columns) * rows,
                                std::numeric_limits<double>::infinity());
  const auto nearest_of = [&](const Projected& p) -> double& {
    return nearest_m[static_cast<std::size_t>(p.v / options.block_px) * columns +
                     p.u / options.block_px];
  };
  for (const Projected& p : seen) nearest_of(p) = std::min(nearest_of(p), p.depth_m);
  std::size_t num_colored = 0;
  for (const Projected& p : seen) {
    const double near_m = nearest_of(p);
    if (p.depth_m > near_m + options.margin_m + options.margin_per_m * near_m) continue;
    points[p.point].rgba = RgbaOf(image.At(p.u, p.v));
    ++num_colored;
  }
  return num_colored;
}

}  // namespace gem
