#include "client/simulation/stereo_camera.h"

#include "client/simulation/random.h"
#include "client/simulation/ray_caster.h"

namespace gem {

void StereoCamera::Scan(const World& world, const Pose<Global, Sensor>& T_G_S, double time_s,
                        std::uint64_t seed, std::uint64_t scan,
                        std::vector<ScanPoint>& points) const {
  points.clear();
  Random random(seed, scan);
  const double focal_px = options_.noise.focal_length_px;
  const double focal_baseline_m = focal_px * options_.noise.baseline_m;
  // The corners of the image look farther than its middle.
  const RayCaster caster(world, T_G_S.translation(), 2 * options_.depth_m_max, time_s);
  const Eigen::Matrix3d R_G_S = T_G_S.matrix();
  for (int v_px = 0; v_px < options_.height_px; v_px += options_.step_px) {
    for (int u_px = 0; u_px < options_.width_px; u_px += options_.step_px) {
      const Eigen::Vector3d ray_S((u_px - 0.5 * options_.width_px) / focal_px,
                                  (v_px - 0.5 * options_.height_px) / focal_px, 1.0);
      // Drawn before the ray is cast: the noise does not depend on what is hit.
      const double disparity_error_px = options_.noise.sigma_disparity_px * random.Gaussian();
      const double u_error_px = options_.noise.sigma_pixel_px * random.Gaussian();
      const double v_error_px = options_.noise.sigma_pixel_px * random.Gaussian();
      const auto hit = caster.Cast((R_G_S * ray_S).normalized());
      if (!hit) continue;
      const double true_depth_m = hit->range_m / ray_S.norm();
      const double disparity_px = focal_baseline_m / true_depth_m + disparity_error_px;
      if (disparity_px * options_.depth_m_max < focal_baseline_m) continue;
      const double depth_m = focal_baseline_m / disparity_px;
      points.push_back({static_cast<float>((ray_S.x() + u_error_px / focal_px) * depth_m),
                        static_cast<float>((ray_S.y() + v_error_px / focal_px) * depth_m),
                        static_cast<float>(depth_m), 0});
    }
  }
}

}  // namespace gem
