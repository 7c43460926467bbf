#include "core/global/gather.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace gem {

Gather::Gather(const Eigen::Matrix3d& R_A_F, const Eigen::Vector3d& t_A_F, double cell_size_m,
               float elevation_m_min, float elevation_m_max)
    : R_(R_A_F),
      t_(t_A_F),
      cell_size_m_(cell_size_m),
      origin_x_(t_A_F.x() / cell_size_m),
      origin_y_(t_A_F.y() / cell_size_m),
      z_min_(elevation_m_min),
      z_max_(elevation_m_max) {
  // p_F(h) = R^T (x, y, h) - R^T t. Taken over z_F instead of h, the line starts at z_F = 0 and
  // leans by the ratio of the components of its direction, the third row of R.
  const double divisor = upright() ? R_(2, 2) : 1.0;
  const double lean_x = R_(2, 0) / divisor;
  const double lean_y = R_(2, 1) / divisor;
  xx_ = R_(0, 0) - R_(0, 2) * lean_x;
  xy_ = R_(1, 0) - R_(1, 2) * lean_x;
  yx_ = R_(0, 1) - R_(0, 2) * lean_y;
  yy_ = R_(1, 1) - R_(1, 2) * lean_y;
  lean_u_ = lean_x / cell_size_m;
  lean_v_ = lean_y / cell_size_m;
  const double middle_m = 0.5 * (z_min_ + z_max_);
  middle_u_ = lean_u_ * middle_m;
  middle_v_ = lean_v_ * middle_m;
  constexpr double kRounding_cells = 1e-6;
  reach_u_ = 0.5 * (z_max_ - z_min_) * std::abs(lean_u_) + kRounding_cells;
  reach_v_ = 0.5 * (z_max_ - z_min_) * std::abs(lean_v_) + kRounding_cells;
  constexpr double kNothing_cells = 1e-9;
  leans_ = (z_max_ - z_min_) * std::max(std::abs(lean_u_), std::abs(lean_v_)) > kNothing_cells;
}

CellWalk::CellWalk(const CellRect& rect, double u, double v, double du, double dv)
    : rect_(rect), u_(u), v_(v), du_(du), dv_(dv) {
  const auto clip = [this](double start, double delta, double min, double max) {
    if (delta == 0) {
      if (!(start >= min && start < max)) done_ = true;
      return;
    }
    const double a = (min - start) / delta;
    const double b = (max - start) / delta;
    enter_ = std::max(enter_, std::min(a, b));
    last_ = std::min(last_, std::max(a, b));
  };
  clip(u, du, rect.min.x, rect.max.x);
  clip(v, dv, rect.min.y, rect.max.y);
  if (done_ || !(enter_ <= last_)) {
    done_ = true;
    return;
  }
  // Rounding may put the entry a hair outside of the rectangle.
  const auto cell_of = [](double at, std::int32_t min, std::int32_t max) {
    return static_cast<std::int32_t>(
        std::clamp(std::floor(at), static_cast<double>(min), max - 1.0));
  };
  cell_ = {cell_of(u + enter_ * du, rect.min.x, rect.max.x),
           cell_of(v + enter_ * dv, rect.min.y, rect.max.y)};
  FindExit();
}

double CellWalk::Border(std::int32_t cell, double start, double delta) const {
  if (delta == 0) return std::numeric_limits<double>::infinity();
  return ((delta > 0 ? cell + 1.0 : static_cast<double>(cell)) - start) / delta;
}

void CellWalk::FindExit() {
  exit_u_ = Border(cell_.x, u_, du_);
  exit_v_ = Border(cell_.y, v_, dv_);
  exit_ = std::min({exit_u_, exit_v_, last_});
}

void CellWalk::Next() {
  if (exit_ >= last_) {
    done_ = true;
    return;
  }
  enter_ = exit_;
  if (exit_u_ <= exit_v_) {
    cell_.x += du_ > 0 ? 1 : -1;
  } else {
    cell_.y += dv_ > 0 ? 1 : -1;
  }
  done_ = !rect_.Contains(cell_);
  if (!done_) FindExit();
}

}  // namespace gem
