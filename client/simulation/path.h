// Where a simulated robot drives: a polyline whose corners are rounded, measured by the way
// travelled.
#pragma once

#include <Eigen/Core>
#include <vector>

namespace gem {

struct PathPose {
  Eigen::Vector2d place_m = Eigen::Vector2d::Zero();
  double yaw_rad = 0;
};

class Path {
 public:
  /// Corners become arcs of `radius_m`, or smaller where the legs are too short for it. At least
  /// two corners; two that follow each other differ, and the path never turns back on itself.
  Path(const std::vector<Eigen::Vector2d>& corners_m, double radius_m);

  double length_m() const { return length_m_; }
  /// After so much way; the ends go on straight before the beginning and beyond the end.
  PathPose At(double way_m) const;

 private:
  /// Straight where curvature_per_m is 0, else an arc; positive turns left.
  struct Piece {
    double begin_m = 0;
    PathPose start;
    double curvature_per_m = 0;
  };
  void Append(const PathPose& start, double curvature_per_m, double piece_length_m);

  // Constant after construction.
  std::vector<Piece> pieces_;
  double length_m_ = 0;
};

}  // namespace gem
