#include "client/simulation/town.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "absl/container/flat_hash_map.h"
#include "client/simulation/random.h"
#include "client/simulation/town_ground.h"
#include "core/base/check.h"
#include "core/grid/cell_index.h"

namespace gem {
namespace {

/// Places in the plane, found by nearness.
class PlaceIndex {
 public:
  void Add(const Eigen::Vector2d& place_m, double value) {
    squares_[PackedKey(CellAt(place_m.x(), place_m.y(), kSquare_m))].push_back({place_m, value});
  }
  /// True if `wanted(place, value)` holds for some place in the squares within reach_m.
  template <typename Wanted>
  bool Any(const Eigen::Vector2d& about_m, double reach_m, const Wanted& wanted) const {
    const CellIndex low = CellAt(about_m.x() - reach_m, about_m.y() - reach_m, kSquare_m);
    const CellIndex high = CellAt(about_m.x() + reach_m, about_m.y() + reach_m, kSquare_m);
    for (CellIndex square = low; square.y <= high.y; ++square.y) {
      for (square.x = low.x; square.x <= high.x; ++square.x) {
        const auto it = squares_.find(PackedKey(square));
        if (it == squares_.end()) continue;
        for (const Entry& entry : it->second)
          if (wanted(entry.place_m, entry.value)) return true;
      }
    }
    return false;
  }

 private:
  static constexpr double kSquare_m = 8;
  struct Entry {
    Eigen::Vector2d place_m;
    double value = 0;
  };
  absl::flat_hash_map<std::uint64_t, std::vector<Entry>> squares_;
};

/// From the place to the nearest of the solid; 0 inside.
double Distance(const Box& box, const Eigen::Vector2d& place_m) {
  const Eigen::Vector2d to_m = place_m - box.center_m;
  const double along_m = std::abs(box.x_axis.dot(to_m)) - 0.5 * box.size_m.x();
  const double across_m =
      std::abs(box.x_axis.x() * to_m.y() - box.x_axis.y() * to_m.x()) - 0.5 * box.size_m.y();
  return std::hypot(std::max(along_m, 0.0), std::max(across_m, 0.0));
}
double Distance(const Cylinder& cylinder, const Eigen::Vector2d& place_m) {
  return std::max((place_m - cylinder.center_m).norm() - cylinder.radius_m, 0.0);
}

/// A place beside the way.
struct Roadside {
  Eigen::Vector2d middle_m;  ///< of the street
  Eigen::Vector2d along;     ///< unit vector
  double side = 1;           ///< 1 left, -1 right

  Eigen::Vector2d At(double aside_m) const {
    return middle_m + side * aside_m * Eigen::Vector2d(-along.y(), along.x());
  }
  double yaw_rad() const { return std::atan2(along.y(), along.x()); }
};

class Furnisher {
 public:
  Furnisher(World& world, const std::vector<Eigen::Vector3d>& way_m, std::uint64_t seed)
      : world_(world), random_(seed, /*stream=*/0) {
    Resample(way_m);
    for (std::size_t i = 0; i < street_m_.size(); ++i)
      way_.Add(street_m_[i], static_cast<double>(i) * kStep_m);
  }

  void Furnish() {
    for (std::size_t i = 2; i + 2 < street_m_.size(); ++i) {
      if (DrivenBefore(i)) continue;
      const Eigen::Vector2d along = (street_m_[i + 2] - street_m_[i - 2]).normalized();
      for (const double side : {1.0, -1.0}) FurnishSide(i, {street_m_[i], along, side});
    }
  }

 private:
  static constexpr double kStep_m = 1.0;

  // Evenly, however the robot sped; where it stood still there is one place.
  void Resample(const std::vector<Eigen::Vector3d>& way_m) {
    street_m_.push_back(way_m.front().head<2>());
    for (const Eigen::Vector3d& place_m : way_m) {
      const Eigen::Vector2d to_m = place_m.head<2>();
      while ((to_m - street_m_.back()).norm() >= kStep_m) {
        const Eigen::Vector2d direction = (to_m - street_m_.back()).normalized();
        street_m_.push_back(street_m_.back() + kStep_m * direction);
      }
    }
  }

  bool DrivenBefore(std::size_t i) const {
    constexpr double kSameStreet_m = 7;
    constexpr double kAgain_m = 40;  // of way: more than the street's curves bring it back
    const double way_m = static_cast<double>(i) * kStep_m;
    return way_.Any(
        street_m_[i], kSameStreet_m, [&](const Eigen::Vector2d& place_m, double driven_m) {
          return driven_m < way_m - kAgain_m && (place_m - street_m_[i]).norm() < kSameStreet_m;
        });
  }

  // Houses first: they need the most room. Every kind has its own period along the street.
  void FurnishSide(std::size_t i, const Roadside& at) {
    if (i % 14 == 4 && Chance(0.85)) {
      const Eigen::Vector2d size_m(7 + 5 * random_.Uniform(), 6 + 3 * random_.Uniform());
      const double aside_m = 8 + 2 * random_.Uniform() + 0.5 * size_m.y();
      Put(MakeBox(at.At(aside_m), size_m, at.yaw_rad(), 0, 1), 5 + 4 * random_.Uniform(), 6.0);
    }
    if (i % 10 == 7 && Chance(0.45)) {
      const Eigen::Vector2d half_m = (3 + random_.Uniform()) * at.along;
      const Eigen::Vector2d middle_m = at.At(6.7 + random_.Uniform());
      Put(MakeWall(middle_m - half_m, middle_m + half_m, 0.25, 0, 1), 1 + random_.Uniform(), 5.0);
    }
    if (i % 9 == 2 && Chance(0.4)) {
      const double yaw_rad = at.yaw_rad() + 0.06 * random_.Gaussian();
      Put(MakeBox(at.At(4.6), {4.2, 1.75}, yaw_rad, 0, 1), 1.4 + 0.3 * random_.Uniform(), 2.8);
    }
    if (i % 11 == 5 && Chance(0.6)) {
      Put(Cylinder{.center_m = at.At(5.6), .radius_m = 0.12 + 0.2 * random_.Uniform()}, 4.0, 4.0);
    }
    if (i % 2 == 0) PutKerb(at);
  }

  bool Chance(double share) { return random_.Uniform() < share; }

  /// Whether nothing of the way comes nearer than clear_m.
  template <typename Solid>
  bool OffTheWay(const Solid& solid, double clear_m) const {
    return !way_.Any(
        solid.center_m, BoundingRadius(solid) + clear_m,
        [&](const Eigen::Vector2d& place_m, double) { return Distance(solid, place_m) < clear_m; });
  }

  template <typename Solid>
  void StandOnGround(Solid& solid, double height_m) const {
    const double ground_m =
        world_.ground().HeightAt(solid.center_m.x(), solid.center_m.y()).value_or(0.0);
    solid.z_m_min = ground_m - 3;  // no slope shows under it
    solid.z_m_max = ground_m + height_m;
  }

  template <typename Solid>
  void Put(Solid solid, double height_m, double clear_m) {
    const double radius_m = BoundingRadius(solid);
    const bool taken =
        solids_.Any(solid.center_m, radius_m + kRadius_m_max,
                    [&](const Eigen::Vector2d& other_m, double other_radius_m) {
                      return (other_m - solid.center_m).norm() < radius_m + other_radius_m;
                    });
    if (taken || !OffTheWay(solid, clear_m)) return;
    GEM_CHECK(radius_m <= kRadius_m_max);
    StandOnGround(solid, height_m);
    solids_.Add(solid.center_m, radius_m);
    world_.Add(solid);
  }

  // Short pieces follow the slope. Cars may stand on them.
  void PutKerb(const Roadside& at) {
    Box kerb = MakeBox(at.At(3.4), {2.0, 0.15}, at.yaw_rad(), 0, 1);
    if (!OffTheWay(kerb, 2.4)) return;
    StandOnGround(kerb, 0.12);
    world_.Add(kerb);
  }

  static constexpr double kRadius_m_max = 8;

  World& world_;
  Random random_;
  std::vector<Eigen::Vector2d> street_m_;  ///< a place every kStep_m of the way
  PlaceIndex way_;                         ///< of street_m_, with the way driven
  PlaceIndex solids_;                      ///< middles and radii of bounding circles
};

}  // namespace

std::unique_ptr<World> BuildTown(const std::vector<Eigen::Vector3d>& way_m,
                                 const TownOptions& options) {
  auto world = std::make_unique<World>(GroundAlong(way_m, options));
  Furnisher(*world, way_m, options.seed).Furnish();
  return world;
}

}  // namespace gem
