// The cpu mapper with several threads, whatever order a sensor measures in. Small enough for
// ThreadSanitizer.
#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <vector>

#include "core/local/cpu/point_pass.h"
#include "core/local/cpu/point_runs.h"
#include "core/local/local_mapper.h"
#include "tests/core/local/scenes.h"

namespace gem {
namespace {

enum class Order { kAsSwept, kTurned, kShuffled };

testing::Lidar SmallLidar() {
  testing::Lidar lidar;
  lidar.columns = 600;
  return lidar;
}

std::vector<ScanPoint> Sweep(Order order, double box_x_m) {
  std::mt19937 random(7);
  testing::World world;
  world.boxes = {testing::BoxOn(box_x_m, 1, 0.6, 1.5), testing::BoxOn(-2, -2, 0.5, 0.8)};
  std::vector<ScanPoint> points =
      SmallLidar().Sweep(world, Pose<Odom, Sensor>::FromTranslation(0, 0, 1.7), random);
  if (order == Order::kShuffled) std::shuffle(points.begin(), points.end(), random);
  if (order == Order::kTurned) {  // the other of direction by direction and ring by ring
    std::stable_sort(points.begin(), points.end(), [](const ScanPoint& a, const ScanPoint& b) {
      return std::atan2(a.y_m, a.x_m) < std::atan2(b.y_m, b.x_m);
    });
  }
  return points;
}

Scan ScanOf(std::span<const ScanPoint> points, int i) {
  Scan scan;
  scan.seq = static_cast<std::uint64_t>(i + 1);
  scan.stamp_ns = i * std::int64_t{100'000'000};
  scan.T_O_B = Pose<Odom, Base>::FromTranslation(0.3 * i, -0.1 * i, 0);
  scan.T_B_S = Pose<Base, Sensor>::FromTranslation(0, 0, 1.7);
  scan.noise = testing::LidarNoiseModel();
  scan.points = points;
  return scan;
}

struct Drive {
  Drive(int threads, Order order) {
    const auto mapper = *MakeLocalMapper(LocalBackend::kCpu, LocalMapOptions(), threads);
    for (int i = 0; i < 6; ++i) {
      const std::vector<ScanPoint> points = Sweep(order, 1.0 + 0.5 * i);
      if (i % 2 == 0) mapper->Expect();
      cleared += mapper->FuseScan(ScanOf(points, i), evicted).cells_cleared;
    }
    mapper->CopyTo(map);
  }
  LocalMap map;
  std::vector<EvictedCell> evicted;
  std::uint64_t cleared = 0;
};

TEST(Threads, GiveTheBytesOfOneWhateverTheOrderOfThePoints) {
  for (const Order order : {Order::kAsSwept, Order::kTurned, Order::kShuffled}) {
    const Drive one(1, order);
    EXPECT_GT(one.cleared, 0u);
    for (const int threads : {2, 3, 5}) {
      const Drive several(threads, order);
      EXPECT_EQ(one.map.state, several.map.state);
      EXPECT_EQ(one.map.elevation_m, several.map.elevation_m);
      EXPECT_EQ(one.map.variance_m2, several.map.variance_m2);
      EXPECT_EQ(one.map.traversability, several.map.traversability);
      EXPECT_EQ(one.map.observed_ns, several.map.observed_ns);
      EXPECT_EQ(one.cleared, several.cleared);
      ASSERT_EQ(one.evicted.size(), several.evicted.size());
    }
  }
}

// Runs of a sweep for two threads: those of one look to the left of the sensor, those of the other
// to the right.
struct Plan {
  explicit Plan(const std::vector<ScanPoint>& points) {
    const LocalMapOptions options;
    const RayBins bins = RayBinsOf(SideCells(options), options.cell_size_m);
    sectors = {AzimuthSector{bins.azimuth / 2, bins.azimuth}, AzimuthSector{0, bins.azimuth / 2}};
    const Scan scan = ScanOf(points, 0);
    runs.Plan(WidestVectorSet(), MakeScanFrame(scan, {}, options), scan, bins, sectors);
    for (const cpu::PointRun& run : runs.runs()) {
      for (std::uint32_t i = run.begin; i < run.end; ++i) {
        const std::int32_t bin = AzimuthBinOf(points[i].x_m, points[i].y_m, bins);
        strays += sectors[run.owner].Holds(bin) ? 0 : 1;
      }
    }
  }
  std::vector<AzimuthSector> sectors;
  cpu::PointRuns runs{2};
  std::size_t strays = 0;
};

TEST(PointRuns, CoverEveryPointOnceAndAreTakenOnce) {
  for (const Order order : {Order::kAsSwept, Order::kTurned, Order::kShuffled}) {
    const std::vector<ScanPoint> points = Sweep(order, 1);
    Plan plan(points);
    std::uint32_t next = 0;
    for (const cpu::PointRun& run : plan.runs.runs()) {
      EXPECT_EQ(run.begin, next);
      EXPECT_LT(run.begin, run.end);
      next = run.end;
    }
    EXPECT_EQ(next, points.size());
    // The second thread takes its own first, then those of the first, which never comes.
    std::vector<int> taken(plan.runs.runs().size());
    for (std::size_t run = plan.runs.Take(1); run != cpu::PointRuns::kNone;
         run = plan.runs.Take(1)) {
      ++taken[run];
    }
    EXPECT_EQ(taken, std::vector<int>(taken.size(), 1));
  }
}

// A tenth of the points may be meant for the wrong thread; without cutting it would be a half.
TEST(PointRuns, MeetFewRaysOfOtherThreads) {
  for (const Order order : {Order::kAsSwept, Order::kTurned}) {
    const std::vector<ScanPoint> points = Sweep(order, 1);
    EXPECT_LT(Plan(points).strays, points.size() / 10);
  }
}

TEST(PointRuns, AScanWithoutPointsHasNone) {
  Plan plan({});
  EXPECT_TRUE(plan.runs.runs().empty());
  EXPECT_EQ(plan.runs.Take(0), cpu::PointRuns::kNone);
}

}  // namespace
}  // namespace gem
