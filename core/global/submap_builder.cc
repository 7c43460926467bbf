#include "core/global/submap_builder.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/global/fusion.h"

namespace gem {
namespace {

// Half a window of the local map and more: cells that a submap may still get lie this near.
constexpr std::int32_t kReachCells = 1024;

// K's height is a round binary number, so that moving heights from O to K loses no digits worth
// keeping.
double RoundHeight(double z_m) { return std::round(z_m * 64.0) / 64.0; }

Eigen::Matrix3d Cross(const Eigen::Vector3d& v) {
  Eigen::Matrix3d cross;
  cross << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return cross;
}

void Extend(CellRect& rect, CellIndex min, CellIndex max) {
  rect = rect.empty() ? CellRect{min, max}
                      : CellRect{{std::min(rect.min.x, min.x), std::min(rect.min.y, min.y)},
                                 {std::max(rect.max.x, max.x), std::max(rect.max.y, max.y)}};
}

}  // namespace

SubmapBuilder::SubmapBuilder(std::string session, std::string robot,
                             const GlobalMapOptions& options)
    : session_(std::move(session)), robot_(std::move(robot)), options_(options) {}

std::shared_ptr<const Submap> SubmapBuilder::Add(std::int64_t stamp_ns,
                                                 const Pose<Odom, Base>& T_O_B,
                                                 const AnchorCovariance& covariance,
                                                 const std::vector<EvictedCell>& evicted) {
  if (!anchor_) SetAnchor(stamp_ns, T_O_B, covariance);
  anchor_->path_m += (T_O_B.translation() - last_position_O_).norm();
  last_position_O_ = T_O_B.translation();
  Insert(evicted);
  if (!Full(T_O_B)) return nullptr;

  std::shared_ptr<const Submap> finished = cells_.empty() ? nullptr : Vectorise();
  Forget();
  SetAnchor(stamp_ns, T_O_B, covariance);
  return finished;
}

std::shared_ptr<const Submap> SubmapBuilder::Finish(const std::vector<EvictedCell>& evicted) {
  if (!anchor_) return nullptr;
  Insert(evicted);
  std::shared_ptr<const Submap> finished = cells_.empty() ? nullptr : Vectorise();
  Forget();
  return finished;
}

std::shared_ptr<const Submap> SubmapBuilder::ActiveSnapshot() const {
  return cells_.empty() ? nullptr : Vectorise();
}

void SubmapBuilder::SetAnchor(std::int64_t stamp_ns, const Pose<Odom, Base>& T_O_B,
                              const AnchorCovariance& covariance) {
  const double cell_size_m = options_.cell_size_m;
  const CellIndex origin = CellAt(T_O_B.translation().x(), T_O_B.translation().y(), cell_size_m);
  const Eigen::Matrix3d R_O_B = T_O_B.matrix();
  anchor_ =
      Anchor{stamp_ns,
             T_O_B,
             Pose<Odom, Submap>::FromTranslation(origin.x * cell_size_m, origin.y * cell_size_m,
                                                 RoundHeight(T_O_B.translation().z())),
             origin,
             R_O_B * covariance.rotation_rad2 * R_O_B.transpose(),
             covariance.translation_m2,
             0.0};
  last_position_O_ = T_O_B.translation();
}

void SubmapBuilder::Insert(const std::vector<EvictedCell>& evicted) {
  for (const EvictedCell& cell_O : evicted) {
    if (!cell_O.belief.known()) continue;
    const CellIndex cell{cell_O.cell.x - anchor_->origin.x, cell_O.cell.y - anchor_->origin.y};
    const bool free =
        cell_O.belief.annotated() && cell_O.belief.traversability > options_.traversability_free;
    if (options_.traversable_only && !free) {
      // What was free and is not any more must not stay free.
      cells_.erase(cell);
      continue;
    }
    const auto [it, inserted] = cells_.try_emplace(cell, cell_O.belief);
    if (inserted) {
      Extend(rect_, cell, {cell.x + 1, cell.y + 1});
      continue;
    }
    CellBelief& stored = it->second;
    const CellBelief& newer = cell_O.belief;
    const bool agree = Agree(newer.elevation_m, newer.variance_m2, stored.elevation_m,
                             stored.variance_m2, options_.gate_sigmas);
    stored = agree ? Fuse(newer, stored) : newer;
  }
}

bool SubmapBuilder::Full(const Pose<Odom, Base>& T_O_B) const {
  if (anchor_->path_m >= options_.submap_length_m) return true;
  if (cells_.empty()) return false;
  const CellIndex robot_O =
      CellAt(T_O_B.translation().x(), T_O_B.translation().y(), options_.cell_size_m);
  const CellIndex robot{robot_O.x - anchor_->origin.x, robot_O.y - anchor_->origin.y};
  CellRect reach = rect_;
  Extend(reach, {robot.x - kReachCells, robot.y - kReachCells},
         {robot.x + kReachCells, robot.y + kReachCells});
  return reach.max.x - reach.min.x > kSubmapSideCells_max ||
         reach.max.y - reach.min.y > kSubmapSideCells_max;
}

// Eqs. (8)-(11). K has the axes of O, so J_s is the identity and J_t its negative; a rotation of
// the robot about its own origin, given in the axes of O, moves the point by the cross product with
// the lever between them, eq. (9).
Covariance3 SubmapBuilder::CovarianceOf(CellIndex cell, const CellBelief& belief) const {
  const double cell_size_m = options_.cell_size_m;
  const Eigen::Vector3d p_O(CenterOf(cell.x + anchor_->origin.x, cell_size_m),
                            CenterOf(cell.y + anchor_->origin.y, cell_size_m), belief.elevation_m);
  const Eigen::Matrix3d J_phi = Cross(p_O - anchor_->T_O_B.translation());
  Eigen::Matrix3d covariance =
      J_phi * anchor_->rotation_rad2 * J_phi.transpose() + anchor_->translation_m2;
  // Within its cell a point may lie anywhere: the variance of a uniform distribution.
  const double place_m2 = cell_size_m * cell_size_m / 12.0;
  covariance.diagonal() += Eigen::Vector3d(place_m2, place_m2, belief.variance_m2);
  return {static_cast<float>(covariance(0, 0)), static_cast<float>(covariance(0, 1)),
          static_cast<float>(covariance(0, 2)), static_cast<float>(covariance(1, 1)),
          static_cast<float>(covariance(1, 2)), static_cast<float>(covariance(2, 2))};
}

std::shared_ptr<const Submap> SubmapBuilder::Vectorise() const {
  std::vector<KeyedSubmapCell> cells;
  cells.reserve(cells_.size());
  const double z_O_K_m = anchor_->T_O_K.translation().z();
  for (const auto& [cell, belief] : cells_) {
    cells.push_back({cell,
                     {static_cast<float>(belief.elevation_m - z_O_K_m), CovarianceOf(cell, belief),
                      belief.traversability, belief.rgba, belief.stamp_ns, belief.state}});
  }
  SubmapOrigin origin;
  origin.session = session_;
  origin.robot = robot_;
  origin.anchor_stamp_ns = anchor_->stamp_ns;
  origin.T_O_K = anchor_->T_O_K;
  origin.cell_size_m = options_.cell_size_m;
  return std::make_shared<const Submap>(std::move(origin), cells);
}

void SubmapBuilder::Forget() {
  anchor_.reset();
  cells_.clear();
  rect_ = {};
}

}  // namespace gem
