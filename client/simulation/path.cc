#include "client/simulation/path.h"

#include <algorithm>
#include <cmath>

#include "core/base/check.h"

namespace gem {
namespace {

Eigen::Vector2d Heading(double yaw_rad) { return {std::cos(yaw_rad), std::sin(yaw_rad)}; }

}  // namespace

Path::Path(const std::vector<Eigen::Vector2d>& corners_m, double radius_m) {
  GEM_CHECK(corners_m.size() >= 2 && radius_m >= 0);
  Eigen::Vector2d from_m = corners_m.front();
  for (std::size_t i = 1; i < corners_m.size(); ++i) {
    const Eigen::Vector2d leg = corners_m[i] - corners_m[i - 1];
    GEM_CHECK(leg.norm() > 0);
    const double yaw_rad = std::atan2(leg.y(), leg.x());
    if (i + 1 == corners_m.size()) {
      Append({from_m, yaw_rad}, 0, (corners_m[i] - from_m).norm());
      break;
    }
    const Eigen::Vector2d next = corners_m[i + 1] - corners_m[i];
    const double turn_rad = std::atan2(leg.x() * next.y() - leg.y() * next.x(), leg.dot(next));
    GEM_CHECK(std::abs(turn_rad) < 3.1);
    // The arc begins this far before the corner; half a leg belongs to either end's corner.
    const double half_tan = std::tan(0.5 * std::abs(turn_rad));
    const double cut_m = std::min({radius_m * half_tan, 0.5 * leg.norm(), 0.5 * next.norm()});
    const Eigen::Vector2d arc_start_m = corners_m[i] - cut_m * leg.normalized();
    Append({from_m, yaw_rad}, 0, (arc_start_m - from_m).norm());
    if (cut_m > 0) {
      const double arc_radius_m = cut_m / half_tan;
      Append({arc_start_m, yaw_rad}, std::copysign(1.0 / arc_radius_m, turn_rad),
             arc_radius_m * std::abs(turn_rad));
    }
    from_m = corners_m[i] + cut_m * next.normalized();
  }
}

void Path::Append(const PathPose& start, double curvature_per_m, double piece_length_m) {
  pieces_.push_back({length_m_, start, curvature_per_m});
  length_m_ += piece_length_m;
}

PathPose Path::At(double way_m) const {
  auto piece = std::upper_bound(pieces_.begin(), pieces_.end(), way_m,
                                [](double way, const Piece& p) { return way < p.begin_m; });
  if (piece != pieces_.begin()) --piece;
  const double along_m = way_m - piece->begin_m;
  const PathPose& start = piece->start;
  if (piece->curvature_per_m == 0)
    return {start.place_m + along_m * Heading(start.yaw_rad), start.yaw_rad};
  const double yaw_rad = start.yaw_rad + along_m * piece->curvature_per_m;
  const Eigen::Vector2d chord(std::sin(yaw_rad) - std::sin(start.yaw_rad),
                              std::cos(start.yaw_rad) - std::cos(yaw_rad));
  return {start.place_m + chord / piece->curvature_per_m, yaw_rad};
}

}  // namespace gem
