// Things that move are forgotten, things that stand are not: a LiDAR in little worlds.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "core/local/local_mapper.h"
#include "tests/core/local/scenes.h"

namespace gem {
namespace {

using testing::Box;
using testing::BoxOn;
using testing::Lidar;
using testing::World;

constexpr double kSensor_m = 1.73;
constexpr double kWalkerSide_m = 0.45;

// 1 m/s across the map, 2 m from where the robot starts and never nearer to it than 1 m: closer by,
// a sensor that looks down by 25 degrees at most sees too little of what it passes over.
Box WalkerAt(int scan) { return BoxOn(-4 + 0.1 * scan, 2.0, kWalkerSide_m, 1.7); }

bool Near(const Box& box, double x_m, double y_m, double margin_m) {
  return x_m > box.min.x() - margin_m && x_m < box.max.x() + margin_m &&
         y_m > box.min.y() - margin_m && y_m < box.max.y() + margin_m;
}

// A robot that creeps along while a walker crosses its map among cubes and a wall.
class Street {
 public:
  explicit Street(float cell_size_m) {
    options_.cell_size_m = cell_size_m;
    options_.side_m = 16;
    mapper_ = *MakeLocalMapper(LocalBackend::kCpu, options_);
    lidar_.sigma_m = 0.01;
    lidar_.columns = 900;
    for (int i = 0; i < 6; ++i) {
      const double angle_rad = 1.05 * i + 0.3, distance_m = 3 + 0.6 * i;
      cubes_.push_back(
          BoxOn(distance_m * std::cos(angle_rad), distance_m * std::sin(angle_rad), 0.5, 0.5));
    }
    world_.boxes = cubes_;
    world_.boxes.push_back({{6, -1.53, 0}, {6.2, 1.47, 1.8}});
  }

  void Step(int i, const Box& walker) {
    World now = world_;
    now.boxes.push_back(walker);
    Scan scan;
    scan.seq = static_cast<std::uint64_t>(i + 1);
    scan.stamp_ns = i * std::int64_t{100'000'000};
    scan.T_O_B = Pose<Odom, Base>::FromYaw(0.01 * i, {0.02 * i, 0.013 * i, 0});
    scan.T_B_S = Pose<Base, Sensor>::FromTranslation(0, 0, kSensor_m);
    scan.noise = testing::LidarNoiseModel();
    sensor_m_ = (scan.T_O_B * scan.T_B_S).translation();
    const auto points = lidar_.Sweep(now, scan.T_O_B * scan.T_B_S, random_);
    scan.points = points;
    mapper_->FuseScan(scan, evicted_);
    mapper_->CopyTo(map_);
  }

  /// Cells of the map at least 0.3 m high whose centre satisfies the condition.
  template <typename Condition>
  int CountHigh(Condition condition) const {
    int count = 0;
    for (std::int32_t row = 0; row < map_.side_cells; ++row) {
      for (std::int32_t column = 0; column < map_.side_cells; ++column) {
        const CellIndex cell{map_.origin.x + column, map_.origin.y + row};
        count += map_.elevation_m[map_.IndexOf(cell)] > 0.3f &&
                 condition(CenterOf(cell.x, map_.cell_size_m), CenterOf(cell.y, map_.cell_size_m));
      }
    }
    return count;
  }
  int CountOn(const Box& box) const {
    return CountHigh([&](double x_m, double y_m) { return Near(box, x_m, y_m, 0); });
  }
  /// High cells off the boxes whose rays the walker has left.
  int CountTrail(const Box& walker) const {
    return CountHigh([&](double x_m, double y_m) {
      const auto near = [&](const Box& box) { return Near(box, x_m, y_m, options_.cell_size_m); };
      return !near(walker) && std::none_of(world_.boxes.begin(), world_.boxes.end(), near) &&
             !HasBoxInSight(walker, x_m, y_m);
    });
  }
  const std::vector<Box>& cubes() const { return cubes_; }

 private:
  // Whether a box stands in the way of a ray over some place of the cell: before the cell, in it,
  // or so close behind it that the ray does not end a range bin beyond it.
  bool HasBoxInSight(const Box& box, double x_m, double y_m) const {
    const double cell_size_m = options_.cell_size_m;
    for (int i = 0; i < 25; ++i) {
      const Eigen::Vector3d place_m(x_m + (i % 5 - 2) * 0.25 * cell_size_m,
                                    y_m + (i / 5 - 2) * 0.25 * cell_size_m, sensor_m_.z());
      const Eigen::Vector3d way_m = place_m - sensor_m_;
      double enter = 0, leave = 1 + 2.5 * cell_size_m / way_m.norm();
      for (int axis = 0; axis < 2; ++axis) {
        const double a = (box.min(axis) - sensor_m_(axis)) / way_m(axis);
        const double b = (box.max(axis) - sensor_m_(axis)) / way_m(axis);
        enter = std::max(enter, std::min(a, b));
        leave = std::min(leave, std::max(a, b));
      }
      if (enter < leave) return true;
    }
    return false;
  }

  LocalMapOptions options_;
  std::unique_ptr<LocalMapper> mapper_;
  Lidar lidar_;
  std::vector<Box> cubes_;
  World world_;
  Eigen::Vector3d sensor_m_;
  std::mt19937 random_{1};
  std::vector<EvictedCell> evicted_;
  LocalMap map_;
};

TEST(Walker, IsGoneOneScanAfterHeLeft) {
  for (const float cell_size_m : {0.1f, 0.2f, 0.4f}) {
    Street street(cell_size_m);
    int walker_cells = 0;
    for (int i = 0; i < 80; ++i) {
      const Box walker = WalkerAt(i);
      street.Step(i, walker);
      walker_cells += street.CountOn(walker);
      EXPECT_EQ(street.CountTrail(walker), 0) << cell_size_m << " m, scan " << i;
    }
    EXPECT_GT(walker_cells, 80) << "he must be seen to be forgotten";
    // Nothing of him is left when he is gone, in whatever order his rays became free.
    const Box away = BoxOn(30, 30, kWalkerSide_m, 1.7);
    street.Step(80, away);
    EXPECT_EQ(street.CountTrail(away), 0);
  }
}

TEST(StaticCubes, AreNeverLost) {
  for (const float cell_size_m : {0.1f, 0.2f, 0.4f}) {
    Street street(cell_size_m);
    std::vector<int> cells(street.cubes().size(), 0);
    for (int i = 0; i < 80; ++i) {
      street.Step(i, WalkerAt(i));
      for (std::size_t k = 0; k < cells.size(); ++k) {
        const Box& cube = street.cubes()[k];
        const int now = street.CountOn(cube);
        EXPECT_TRUE(i <= 5 || now >= cells[k]) << cell_size_m << " cube " << k << " scan " << i;
        cells[k] = std::max(cells[k], now);
      }
    }
    for (const int count : cells) EXPECT_GE(count, 1);
  }
}

}  // namespace
}  // namespace gem
