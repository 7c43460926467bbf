#include "core/local/measure.h"

#include "core/sensor/scan.h"

namespace gem {
namespace {

void CopyRows(const Eigen::Matrix3d& from, float (&to)[3][3]) {
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) {
      to[row][column] = static_cast<float>(from(row, column));
    }
  }
}

}  // namespace

ScanFrame MakeScanFrame(const Scan& scan, CellIndex origin, const LocalMapOptions& options) {
  const Pose<Odom, Sensor> T_O_S = scan.T_O_B * scan.T_B_S;
  const double cell_size_m = options.cell_size_m;
  const Eigen::Vector2d corner_m(origin.x * cell_size_m, origin.y * cell_size_m);
  const Eigen::Vector2d sensor_m = T_O_S.translation().head<2>() - corner_m;
  const Eigen::Vector2d base_m = scan.T_O_B.translation().head<2>() - corner_m;
  const Eigen::Matrix3d R_OB = scan.T_O_B.matrix();
  const Eigen::Matrix3d phi_O = R_OB * scan.rotation_covariance_rad2 * R_OB.transpose();

  ScanFrame frame{};
  CopyRows(T_O_S.matrix(), frame.R_OS);
  CopyRows(scan.T_B_S.matrix(), frame.R_BS);
  for (int i = 0; i < 3; ++i) {
    frame.t_BS_m[i] = static_cast<float>(scan.T_B_S.translation()(i));
  }
  frame.sensor_x_m = static_cast<float>(sensor_m.x());
  frame.sensor_y_m = static_cast<float>(sensor_m.y());
  frame.sensor_z_m = static_cast<float>(T_O_S.translation().z());
  frame.sensor_over_base_m =
      static_cast<float>(T_O_S.translation().z() - scan.T_O_B.translation().z());
  frame.base_x_m = static_cast<float>(base_m.x());
  frame.base_y_m = static_cast<float>(base_m.y());
  frame.phi_xx_rad2 = static_cast<float>(phi_O(0, 0));
  frame.phi_xy_rad2 = static_cast<float>(phi_O(0, 1));
  frame.phi_yy_rad2 = static_cast<float>(phi_O(1, 1));
  frame.range2_m2_min = options.range_m_min * options.range_m_min;
  frame.range2_m2_max = options.range_m_max * options.range_m_max;
  frame.height_m_min = options.height_m_min;
  frame.height_m_max = options.height_m_max;
  frame.body = options.body;
  frame.has_body = options.body.x_m_min < options.body.x_m_max &&
                   options.body.y_m_min < options.body.y_m_max &&
                   options.body.z_m_min < options.body.z_m_max;
  frame.cell_size_m = options.cell_size_m;
  frame.side_cells = SideCells(options);
  frame.noise = scan.noise;
  return frame;
}

}  // namespace gem
