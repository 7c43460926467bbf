// Looks straight down on a height field from another frame: which of its cells lies under a cell's
// centre there, and how high is it? The way tiles are composed and submaps are merged.
//
// Seen from its own frame F the vertical line of frame A leans if F is tilted. It is followed from
// the top of the field downwards, cell by cell, until it meets one: so the highest surface is
// found, steps included, and a fully observed field has no holes whatever its rotation. No cell is
// interpolated; if A and F differ by whole cells, every cell comes out as it went in.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <optional>

#include "core/grid/cell_index.h"

namespace gem {

/// What a vertical line met.
struct GatherHit {
  std::size_t position = 0;  ///< of the cell, in the field
  float elevation_m = 0;     ///< over z = 0 of A, of the cell's plane at the line
};

class Gather {
 public:
  /// R_A_F, t_A_F: pose of the field. Between elevation_m_min and _max lie all its cells.
  Gather(const Eigen::Matrix3d& R_A_F, const Eigen::Vector3d& t_A_F, double cell_size_m,
         float elevation_m_min, float elevation_m_max);

  /// A field that lies on its side or upside down is no height field in A: it has no hits.
  bool upright() const { return R_.coeff(2, 2) > kUpright_min; }

  /// Field: rect(), Find(CellIndex) -> optional position, elevation_m(position). Needs upright().
  template <typename Field>
  std::optional<GatherHit> At(const Field& field, CellIndex cell_A) const {
    const double x = cell_A.x + 0.5 - origin_x_;
    const double y = cell_A.y + 0.5 - origin_y_;
    const double u = xx_ * x + xy_ * y;
    const double v = yx_ * x + yy_ * y;
    // Most lines lean so little that they stay within one cell from the top to the bottom.
    const std::optional<std::size_t> position = leans_ && !StaysInOneCell(u, v)
                                                    ? Descend(field, u, v)
                                                    : FindAt(field, u + middle_u_, v + middle_v_);
    if (!position) return std::nullopt;
    const double level_m = (R_.coeff(0, 2) * x + R_.coeff(1, 2) * y) * cell_size_m_;
    const double z_A = (field.elevation_m(*position) - level_m) / R_.coeff(2, 2) + t_.z();
    return GatherHit{*position, static_cast<float>(z_A)};
  }

 private:
  /// cos 80 degrees.
  static constexpr double kUpright_min = 0.17;

  template <typename Field>
  static std::optional<std::size_t> FindAt(const Field& field, double u, double v) {
    const CellRect& rect = field.rect();
    // Compared before it is converted: a far coordinate does not fit an integer.
    if (!(u >= rect.min.x && u < rect.max.x && v >= rect.min.y && v < rect.max.y))
      return std::nullopt;
    return field.Find(
        {static_cast<std::int32_t>(std::floor(u)), static_cast<std::int32_t>(std::floor(v))});
  }

  /// Whether the line that crosses z = 0 of F at (u, v) surely crosses no border of a cell between
  /// the heights of the field.
  bool StaysInOneCell(double u, double v) const {
    const auto stays = [](double at, double reach) {
      const double in_cell = at - std::floor(at);
      return in_cell > reach && in_cell < 1.0 - reach;
    };
    return stays(u + middle_u_, reach_u_) && stays(v + middle_v_, reach_v_);
  }

  /// (u, v): where the line crosses z = 0 of F, in cells.
  template <typename Field>
  std::optional<std::size_t> Descend(const Field& field, double u, double v) const;

  Eigen::Matrix3d R_;
  Eigen::Vector3d t_;
  double cell_size_m_;
  double origin_x_, origin_y_;  ///< t_A_F in cells
  double xx_, xy_, yx_, yy_;    ///< cells of A to cells of F at z = 0 of F, along z of A
  double lean_u_, lean_v_;      ///< cells of F that the line moves a metre of height in F
  double z_min_, z_max_;        ///< of the field, in F
  double middle_u_, middle_v_;  ///< shift of the line at the middle of the field's heights
  double reach_u_, reach_v_;    ///< from there to the top or the bottom, and what rounding may add
  bool leans_ = false;          ///< the line may cross more than one cell
};

/// The part of a line (u, v) + s * (du, dv), s from 0 to 1, that lies in a rectangle, cell by cell.
class CellWalk {
 public:
  CellWalk(const CellRect& rect, double u, double v, double du, double dv);

  bool done() const { return done_; }
  CellIndex cell() const { return cell_; }
  double enter() const { return enter_; }  ///< s at which the line enters the cell
  double exit() const { return exit_; }    ///< s at which it leaves it; 1 exactly if it ends there
  void Next();

 private:
  double Border(std::int32_t cell, double start, double delta) const;
  void FindExit();

  CellRect rect_;
  double u_, v_, du_, dv_;
  double last_ = 1;  ///< s at which the line leaves the rectangle
  double enter_ = 0, exit_ = 1;
  double exit_u_ = 0, exit_v_ = 0;
  CellIndex cell_;
  bool done_ = false;
};

template <typename Field>
std::optional<std::size_t> Gather::Descend(const Field& field, double u, double v) const {
  const double top_u = u + lean_u_ * z_max_;
  const double top_v = v + lean_v_ * z_max_;
  const double fall_m = z_min_ - z_max_;
  bool came_from_known = false;
  for (CellWalk walk(field.rect(), top_u, top_v, lean_u_ * fall_m, lean_v_ * fall_m); !walk.done();
       walk.Next()) {
    const std::optional<std::size_t> position = field.Find(walk.cell());
    if (!position) {
      came_from_known = false;
      continue;
    }
    const double elevation_m = field.elevation_m(*position);
    const double z_enter = z_max_ + walk.enter() * fall_m;
    const double z_exit = walk.exit() < 1 ? z_max_ + walk.exit() * fall_m : z_min_;
    if (elevation_m >= z_exit) {
      // Through the side of a step: the higher cell. Coming from an unknown cell, the line may have
      // met anything there: unknown.
      if (elevation_m > z_enter && !came_from_known) return std::nullopt;
      return position;
    }
    came_from_known = true;
  }
  return std::nullopt;
}

}  // namespace gem
