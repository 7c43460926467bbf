#include "client/evaluation/road_truth.h"

#include "core/grid/cell_index.h"

namespace gem::evaluation {
namespace {

constexpr double kRoadHalf_m = 2;
constexpr double kSquare_m = kRoadHalf_m;

}  // namespace

RoadTruth::RoadTruth(const TownDrive& town) : town_(town) {
  for (const Pose<Global, Base>& pose : town.drive.truth)
    places_[PackedKey(CellAt(pose.translation().x(), pose.translation().y(), kSquare_m))].push_back(
        pose.translation().head<2>());
}

std::optional<double> RoadTruth::operator()(double x_m, double y_m) const {
  const CellIndex square = CellAt(x_m, y_m, kSquare_m);
  for (int dy = -1; dy <= 1; ++dy) {
    for (int dx = -1; dx <= 1; ++dx) {
      const auto it = places_.find(PackedKey({square.x + dx, square.y + dy}));
      if (it == places_.end()) continue;
      for (const Eigen::Vector2d& place_m : it->second)
        if ((place_m - Eigen::Vector2d(x_m, y_m)).norm() < kRoadHalf_m)
          return town_.town->ground().HeightAt(x_m, y_m);
    }
  }
  return std::nullopt;
}

}  // namespace gem::evaluation
