// What DESIGN promises of the local map, one sentence a test, for every backend.
#include "core/local/local_mapper.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

#include "tests/core/local/compare_maps.h"
#include "tests/core/local/scenes.h"

namespace gem {
namespace {

using testing::EveryPointCountedOnce;
using testing::PointScan;

constexpr CellRect kAround{{-20, -20}, {20, 20}};  // the default window of a robot at the origin

class LocalMapperTest : public ::testing::TestWithParam<LocalBackend> {
 protected:
  LocalMapperTest() {
    options_.range_m_min = 0;
    options_.variance_growth_m2_per_s = 0;
    options_.variance_growth_m2_per_m = 0;
    MakeAgain();
  }
  void MakeAgain() { mapper_ = *MakeLocalMapper(GetParam(), options_); }

  ScanReport Fuse(const Scan& scan) {
    evicted_.clear();
    const ScanReport report = mapper_->FuseScan(scan, evicted_);
    mapper_->CopyTo(map_);
    EXPECT_TRUE(EveryPointCountedOnce(report));
    return report;
  }
  std::size_t IndexAt(double x_m, double y_m) const {
    return map_.IndexOf(CellAt(x_m, y_m, options_.cell_size_m));
  }
  CellBelief At(double x_m, double y_m) const { return map_.BeliefAt(IndexAt(x_m, y_m)); }

  /// Flat ground in every cell but where `hole` says so; twice, so that it is annotated and sure.
  template <typename Hole>
  void LearnGround(double sensor_z_m, Hole hole) {
    PointScan ground(sensor_z_m);
    for (std::int32_t y = -20; y < 20; ++y) {
      for (std::int32_t x = -20; x < 20; ++x) {
        const double x_m = CenterOf(x, options_.cell_size_m);
        const double y_m = CenterOf(y, options_.cell_size_m);
        if (!hole(x_m, y_m)) ground.Add(x_m, y_m, 0);
      }
    }
    Fuse(ground.At(1));
  }
  void LearnGround(double sensor_z_m = 1.0) {
    LearnGround(sensor_z_m, [](double, double) { return false; });
  }

  LocalMapOptions options_;
  std::unique_ptr<LocalMapper> mapper_;
  std::vector<EvictedCell> evicted_;
  LocalMap map_;
};

INSTANTIATE_TEST_SUITE_P(Backends, LocalMapperTest,
                         ::testing::Values(LocalBackend::kReference, LocalBackend::kCpu),
                         [](const auto& backend) { return std::string(NameOf(backend.param)); });

// ---- window

TEST_P(LocalMapperTest, APointIsServedAtItsPlaceFromTheLowerLeft) {
  PointScan scan;
  scan.Add(0.3, -0.5, 0.25, 0xff112233u);
  Fuse(scan.At(7));
  EXPECT_EQ(map_.origin, (CellIndex{-20, -20}));
  EXPECT_EQ(map_.side_cells, 40);
  EXPECT_EQ(map_.seq, 7u);
  EXPECT_EQ(map_.stamp_ns, 700'000'000);
  // Column 21, row 17.
  const CellBelief cell = map_.BeliefAt(17 * 40 + 21);
  EXPECT_FLOAT_EQ(cell.elevation_m, 0.25f);
  EXPECT_NEAR(cell.variance_m2, 0.01, 1e-6);
  EXPECT_EQ(cell.rgba, 0xff112233u);
  EXPECT_EQ(cell.stamp_ns, 700'000'000);
  EXPECT_EQ(cell.state, kCellKnown | kCellColored);
}

TEST_P(LocalMapperTest, ValuesWithoutTheirStateBitAreZero) {
  PointScan scan;
  scan.Add(0.3, -0.5, 0.25);
  Fuse(scan.At(1));
  int known = 0;
  for (std::size_t i = 0; i < map_.num_cells(); ++i) {
    EXPECT_EQ(map_.slope_rad[i], 0);
    EXPECT_EQ(map_.roughness_m[i], 0);
    if (map_.BeliefAt(i).known()) {
      ++known;
    } else {
      EXPECT_EQ(map_.BeliefAt(i), CellBelief());
    }
  }
  EXPECT_EQ(known, 1);
}

TEST_P(LocalMapperTest, TheWindowMovesByWholeCellsAndKeepsWhatItHolds) {
  LearnGround();
  const CellBelief before = At(2.1, 1.1);
  PointScan moved(Pose<Odom, Base>::FromTranslation(0.55, -0.45, 0), {});
  const ScanReport report = Fuse(moved.At(2));
  EXPECT_EQ(map_.origin, (CellIndex{-18, -23}));
  EXPECT_EQ(At(2.1, 1.1), before);
  EXPECT_EQ(report.cells_evicted, 40u * 40 - 38 * 37);
  EXPECT_EQ(evicted_.size(), report.cells_evicted);
}

TEST_P(LocalMapperTest, EvictedCellsComeByRowThenColumnWithAllTheyHeld) {
  PointScan scan;
  scan.Add(-3.9, -3.9, 0.1).Add(3.9, -3.9, 0.2).Add(-3.9, 0.1, 0.3).Add(3.9, 3.9, 0.4);
  Fuse(scan.At(1));
  const CellBelief corner = At(-3.9, -3.9);
  PointScan moved(Pose<Odom, Base>::FromTranslation(0.25, 0.25, 0), {});
  Fuse(moved.At(2));
  ASSERT_EQ(evicted_.size(), 3u);
  EXPECT_EQ(evicted_[0].cell, (CellIndex{-20, -20}));
  EXPECT_EQ(evicted_[1].cell, (CellIndex{19, -20}));
  EXPECT_EQ(evicted_[2].cell, (CellIndex{-20, 0}));
  EXPECT_EQ(evicted_[0].belief, corner);
  EXPECT_FLOAT_EQ(At(3.9, 3.9).elevation_m, 0.4f);
}

TEST_P(LocalMapperTest, AJumpBeyondTheWindowEvictsEverything) {
  LearnGround();
  PointScan far(Pose<Odom, Base>::FromTranslation(-900'000, 900'000, 5), {});
  far.Add(-900'001, 900'001, 5);
  const ScanReport report = Fuse(far.At(2));
  EXPECT_EQ(report.cells_evicted, 1600u);
  EXPECT_FLOAT_EQ(At(-900'001, 900'001).elevation_m, 5);
  mapper_->CopyTo(map_);
  EXPECT_EQ(std::count(map_.state.begin(), map_.state.end(), 0), 1599);
}

TEST_P(LocalMapperTest, EvictAllForgetsEveryCell) {
  LearnGround();
  evicted_.clear();
  mapper_->EvictAll(evicted_);
  ASSERT_EQ(evicted_.size(), 1600u);
  EXPECT_EQ(evicted_.front().cell, (CellIndex{-20, -20}));
  EXPECT_EQ(evicted_[1].cell, (CellIndex{-19, -20}));
  EXPECT_EQ(evicted_.back().cell, (CellIndex{19, 19}));
  mapper_->CopyTo(map_);
  for (std::size_t i = 0; i < map_.num_cells(); ++i) EXPECT_EQ(map_.BeliefAt(i), CellBelief());
}

TEST_P(LocalMapperTest, EveryCellIsEvictedExactlyOnceOnALongWay) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> offset_m(-3.9, 3.9);
  std::vector<EvictedCell> all;
  std::vector<std::uint64_t> seen;
  for (int i = 0; i < 60; ++i) {
    const double x_m = 0.37 * i, y_m = -0.21 * i;
    PointScan scan(Pose<Odom, Base>::FromTranslation(x_m, y_m, 0), {});
    for (int k = 0; k < 200; ++k) scan.Add(x_m + offset_m(random), y_m + offset_m(random), 0);
    Fuse(scan.At(static_cast<std::uint64_t>(i + 1)));
    all.insert(all.end(), evicted_.begin(), evicted_.end());
  }
  mapper_->EvictAll(all);
  for (const EvictedCell& cell : all) seen.push_back(PackedKey(cell.cell));
  std::sort(seen.begin(), seen.end());
  // A straight way never comes back to a cell that it left.
  EXPECT_EQ(std::adjacent_find(seen.begin(), seen.end()), seen.end());
  EXPECT_GT(seen.size(), 2500u);
}

// ---- counts

TEST_P(LocalMapperTest, CountsEveryPointByItsFate) {
  options_.range_m_min = 0.5f;
  options_.body = {-1, -1, -1, 1, 1, 2};
  MakeAgain();
  PointScan scan(1.0);
  scan.Add(0, 0, 0.9);                       // 0.1 m from the sensor
  scan.Add(200, 0, 0);                       // beyond 120 m
  scan.Add(0.9, 0.9, 0);                     // body
  scan.Add(2, 0, -11).Add(2, 0, 3.5);        // too low, too high
  scan.Add(10, 0, 0);                        // not over the window
  scan.Add(2.1, 0.1, 0).Add(2.1, 0.1, 2.0);  // one far below the other in one cell
  const ScanReport report = Fuse(scan.At(1));
  EXPECT_EQ(report.points, 8u);
  EXPECT_EQ(report.points_out_of_range, 2u);
  EXPECT_EQ(report.points_on_body, 1u);
  EXPECT_EQ(report.points_out_of_height, 2u);
  EXPECT_EQ(report.points_outside_window, 1u);
  EXPECT_EQ(report.points_fused, 1u);
  EXPECT_EQ(report.points_gated, 1u);
}

TEST_P(LocalMapperTest, AnEmptyScanMovesTheWindowAndNothingElse) {
  LearnGround();
  PointScan empty(Pose<Odom, Base>::FromTranslation(0.25, 0, 0), {});
  const ScanReport report = Fuse(empty.At(2));
  EXPECT_EQ(report.points, 0u);
  EXPECT_EQ(report.cells_evicted, 40u);
  EXPECT_EQ(map_.seq, 2u);
}

// ---- fusing over time

TEST_P(LocalMapperTest, VarianceGrowsWithTimeAndStopsAtTheCap) {
  options_.variance_growth_m2_per_s = 1e-3f;
  options_.variance_m2_max = 0.02f;
  MakeAgain();
  PointScan scan, empty;
  scan.Add(1.1, 1.1, 0);
  Fuse(scan.At(10));
  Fuse(empty.At(30));  // 2 s later
  EXPECT_NEAR(At(1.1, 1.1).variance_m2, 0.01 + 0.002, 1e-6);
  EXPECT_EQ(At(1.1, 1.1).stamp_ns, 1'000'000'000);
  Fuse(empty.At(1000));
  EXPECT_FLOAT_EQ(At(1.1, 1.1).variance_m2, 0.02f);
  EXPECT_EQ(At(-1.1, 1.1), CellBelief());  // unknown cells stay zero
}

TEST_P(LocalMapperTest, GroundThatSankIsLearntAgain) {
  // In the original a point below the gate is ignored for ever.
  LearnGround();
  int scans = 0;
  for (; scans < 20 && At(1.1, 1.1).elevation_m > -0.45f; ++scans) {
    PointScan sunk;
    sunk.AddCells(kAround, 0.2, [](double, double) { return -0.5; });
    sunk.scan().noise = {.along_beam = true, .axial_m = {0.02f, 0, 0}, .lateral_m = {0.02f, 0}};
    const ScanReport report = Fuse(sunk.At(static_cast<std::uint64_t>(scans + 2)));
    EXPECT_TRUE(scans > 0 || report.cells_inflated == 1600u);
  }
  // 0.01 m^2 is three sigmas of 0.3 m; fourfold 0.6 m: the second scan passes, the third is there.
  EXPECT_LE(scans, 3);
}

TEST_P(LocalMapperTest, LowerPointsDoNotWearAnObstacleDown) {
  LearnGround();
  PointScan wall;
  for (int y = -3; y < 3; ++y) wall.Add(2.1, CenterOf(y, 0.2), 1.5);
  Fuse(wall.At(2));
  ASSERT_FLOAT_EQ(At(2.1, 0.1).elevation_m, 1.5f);
  PointScan foot;
  for (int y = -3; y < 3; ++y) foot.Add(2.01, CenterOf(y, 0.2), 0.2);
  for (std::uint64_t seq = 3; seq < 30; ++seq) {
    const ScanReport report = Fuse(foot.At(seq));
    EXPECT_EQ(report.cells_inflated, 0u);
  }
  EXPECT_FLOAT_EQ(At(2.1, 0.1).elevation_m, 1.5f);
}

// ---- annotating

TEST_P(LocalMapperTest, ASlopeReadsTheSameOnBothSidesOfTheSeam) {
  // The original fitted planes in coordinates of the ring buffer: 11 degrees read 0.2 at the seam.
  // The window's corner is at a different place of the ring for each of these poses.
  const double rise = std::tan(11 * std::numbers::pi / 180);
  for (const double at_m : {0.0, 1.3, 4.1, -2.7}) {
    MakeAgain();
    PointScan scan(Pose<Odom, Base>::FromTranslation(at_m, -at_m, 0), {});
    const CellIndex base = CellAt(at_m, -at_m, options_.cell_size_m);
    scan.AddCells({{base.x - 20, base.y - 20}, {base.x + 20, base.y + 20}}, options_.cell_size_m,
                  [&](double x_m, double y_m) { return rise * (0.6 * x_m + 0.8 * y_m); });
    Fuse(scan.At(1));
    for (std::size_t i = 0; i < map_.num_cells(); ++i) {
      ASSERT_TRUE(map_.BeliefAt(i).annotated()) << i;
      EXPECT_NEAR(map_.slope_rad[i], 11 * std::numbers::pi / 180, 1e-4) << i;
    }
  }
}

TEST_P(LocalMapperTest, SmallCellsHaveSlopesToo) {
  // An absolute epsilon of the original read slopes of small cells as zero.
  options_.cell_size_m = 0.01f;
  options_.side_m = 0.2f;
  options_.variance_m2_min = 1e-8f;
  MakeAgain();
  PointScan scan;
  scan.scan().noise = {.along_beam = true, .axial_m = {1e-3f, 0, 0}, .lateral_m = {1e-3f, 0}};
  scan.AddCells({{-10, -10}, {10, 10}}, options_.cell_size_m,
                [](double x_m, double) { return 0.2 * x_m; });
  Fuse(scan.At(1));
  EXPECT_NEAR(map_.slope_rad[IndexAt(0, 0)], std::atan(0.2), 1e-3);
}

TEST_P(LocalMapperTest, UnknownIsNeverFreeAndFewCellsMakeNoAnnotation) {
  PointScan scan;
  for (int i = 0; i < 7; ++i) scan.Add(0.1 + 0.2 * (i % 4), 0.1 + 0.2 * (i / 4), 0);
  Fuse(scan.At(1));
  EXPECT_FALSE(At(0.1, 0.1).annotated());  // seven cells are too few
  PointScan one;
  one.Add(0.7, 0.3, 0);
  Fuse(one.At(2));
  EXPECT_TRUE(At(0.3, 0.1).annotated());  // the eighth is enough, for those that see all eight
  EXPECT_FLOAT_EQ(At(0.3, 0.1).traversability, 1);
  EXPECT_FALSE(At(0.1, 0.1).annotated());
  for (std::size_t i = 0; i < map_.num_cells(); ++i) {
    EXPECT_TRUE(map_.BeliefAt(i).known() || map_.traversability[i] == 0) << i;
  }
}

TEST_P(LocalMapperTest, ACurbIsAnObstacleAndTheGroundBesideItIsFree) {
  PointScan scan;
  scan.AddCells(kAround, 0.2, [](double x_m, double) { return x_m > 1.0 ? 0.2 : 0.0; });
  Fuse(scan.At(1));
  EXPECT_LT(At(0.9, 0.1).traversability, options_.traversability_free);
  EXPECT_LT(At(1.1, 0.1).traversability, options_.traversability_free);
  EXPECT_FLOAT_EQ(At(0.3, 0.1).traversability, 1);
  EXPECT_FLOAT_EQ(At(1.7, 0.1).traversability, 1);
}

TEST_P(LocalMapperTest, A480CellWindowWorks) {
  // Arrays on the stack of the original overflowed at this size.
  options_.side_m = 96;
  MakeAgain();
  PointScan scan;
  for (int y = -200; y < 200; ++y) {
    for (int x = -200; x < 200; ++x) scan.Add(CenterOf(x, 0.2), CenterOf(y, 0.2), 0);
  }
  const ScanReport report = Fuse(scan.At(1));
  EXPECT_EQ(map_.side_cells, 480);
  EXPECT_EQ(report.points_fused, 160'000u);
  EXPECT_EQ(std::count_if(map_.traversability.begin(), map_.traversability.end(),
                          [](float v) { return v > 0.99f; }),
            160'000);
}

// ---- clearing

// Plants a post of 1 m at (x, y) on known ground, then sends one ray past it.
class ClearingTest : public LocalMapperTest {
 protected:
  void Plant(double x_m, double y_m, double ground_m = 0) {
    PointScan ground(Pose<Odom, Base>::FromTranslation(0, 0, ground_m),
                     Pose<Base, Sensor>::FromTranslation(0, 0, 1.7));
    ground.AddCells(kAround, 0.2, [&](double, double) { return ground_m; });
    ground.scan().noise = {.along_beam = true, .axial_m = {0.02f, 0, 0}, .lateral_m = {0.02f, 0}};
    Fuse(ground.At(1));
    PointScan post(Pose<Odom, Base>::FromTranslation(0, 0, ground_m),
                   Pose<Base, Sensor>::FromTranslation(0, 0, 1.7));
    post.Add(x_m, y_m, ground_m + 1.0);
    post.scan().noise = ground.scan().noise;
    Fuse(post.At(2));
    ASSERT_FLOAT_EQ(At(x_m, y_m).elevation_m, static_cast<float>(ground_m + 1.0));
  }
  ScanReport SendRay(double x_m, double y_m, double z_m, double ground_m = 0) {
    PointScan ray(Pose<Odom, Base>::FromTranslation(0, 0, ground_m),
                  Pose<Base, Sensor>::FromTranslation(0, 0, 1.7));
    ray.Add(x_m, y_m, z_m);
    ray.scan().noise = {.along_beam = true, .axial_m = {0.02f, 0, 0}, .lateral_m = {0.02f, 0}};
    return Fuse(ray.At(3));
  }
};

INSTANTIATE_TEST_SUITE_P(Backends, ClearingTest,
                         ::testing::Values(LocalBackend::kReference, LocalBackend::kCpu),
                         [](const auto& backend) { return std::string(NameOf(backend.param)); });

TEST_P(ClearingTest, ARayBelowResetsEveryLayerAndTheNeighboursAreAnnotatedAnew) {
  Plant(2.1, 0.1);
  ASSERT_LT(At(2.3, 0.3).traversability, options_.traversability_free);
  // To the ground at 3.6 m: 0.77 m high where it enters the cell.
  const ScanReport report = SendRay(3.6, 0.17, 0.0);
  EXPECT_EQ(report.cells_cleared, 1u);
  EXPECT_EQ(At(2.1, 0.1), CellBelief());
  EXPECT_EQ(map_.slope_rad[IndexAt(2.1, 0.1)], 0);
  EXPECT_EQ(map_.roughness_m[IndexAt(2.1, 0.1)], 0);
  EXPECT_FLOAT_EQ(At(2.3, 0.3).traversability, 1);
}

TEST_P(ClearingTest, WorksAlongBothAxesAndAtAnyAltitude) {
  // The original cleared neither axis-aligned obstacles nor anything above 10 m.
  for (const double ground_m : {0.0, 12.0, 1500.0, -300.0}) {
    for (const auto& [x, y] : {std::pair{1, 0}, {0, 1}, {-1, 0}, {0, -1}}) {
      MakeAgain();
      // Cells on both sides of the axis: the sensor stands on a corner of four.
      Plant(2.1 * x + 0.01, 2.1 * y + 0.01, ground_m);
      const ScanReport report = SendRay(3.6 * x + 0.02, 3.6 * y + 0.02, ground_m, ground_m);
      EXPECT_EQ(report.cells_cleared, 1u) << ground_m << " " << x << " " << y;
    }
  }
}

TEST_P(ClearingTest, ARayThatEndsInOrBeforeTheCellProvesNothing) {
  Plant(2.1, 0.1);
  EXPECT_EQ(SendRay(2.01, 0.1, 0.0).cells_cleared, 0u);
  EXPECT_EQ(SendRay(1.5, 0.07, 0.0).cells_cleared, 0u);
  EXPECT_FLOAT_EQ(At(2.1, 0.1).elevation_m, 1.0f);
}

TEST_P(ClearingTest, ARayAboveOrWithinThreeSigmaProvesNothing) {
  Plant(2.1, 0.1);
  // The variance is 4e-4 m^2, so the cell surely reaches 0.94 m. Entering the cell 2.0023 m away, a
  // ray to z metres 3.6 m away is 1.7 - (1.7 - z) * 2.0023 / 3.6040 m high.
  EXPECT_EQ(SendRay(3.6, 0.17, 0.35).cells_cleared, 0u);  // 0.950 m
  EXPECT_EQ(SendRay(3.6, 0.17, 0.30).cells_cleared, 1u);  // 0.922 m
}

TEST_P(ClearingTest, ACellConfirmedInThisScanIsKept) {
  Plant(2.1, 0.1);
  PointScan scan(Pose<Odom, Base>(), Pose<Base, Sensor>::FromTranslation(0, 0, 1.7));
  scan.Add(3.6, 0.17, 0.0).Add(2.05, 0.1, 0.99);
  EXPECT_EQ(Fuse(scan.At(3)).cells_cleared, 0u);
}

TEST_P(ClearingTest, AClearedCellRestartsFromTheScansOwnPoints) {
  // A lower point in it does not protect it, or a walker's cell would stay once the ground shows.
  Plant(2.1, 0.1);
  PointScan scan(Pose<Odom, Base>(), Pose<Base, Sensor>::FromTranslation(0, 0, 1.7));
  scan.Add(3.6, 0.17, 0.0).Add(2.05, 0.1, 0.01);
  const ScanReport report = Fuse(scan.At(3));
  EXPECT_EQ(report.cells_cleared, 1u);
  EXPECT_EQ(report.points_fused, 2u);
  EXPECT_EQ(report.points_gated, 0u);
  EXPECT_NEAR(At(2.1, 0.1).elevation_m, 0.01, 1e-6);
  EXPECT_TRUE(At(2.1, 0.1).annotated());
  EXPECT_GT(At(2.1, 0.1).traversability, 0.9f);
}

TEST_P(ClearingTest, FreeGroundIsNotClearedByRaysJustBelowIt) {
  // Odometry that sank by 0.1 m sees rays pass below ground that it does not observe.
  Plant(2.1, 0.1);
  const ScanReport report = SendRay(3.6, -1.9, -0.1);
  EXPECT_EQ(report.cells_cleared, 0u);
}

TEST_P(ClearingTest, AFloatingCellWithoutNeighboursIsCleared) {
  PointScan post(1.7);
  post.Add(2.1, 0.1, 1.0);
  post.scan().noise = {.along_beam = true, .axial_m = {0.02f, 0, 0}, .lateral_m = {0.02f, 0}};
  Fuse(post.At(1));
  ASSERT_FALSE(At(2.1, 0.1).annotated());
  EXPECT_EQ(SendRay(3.6, 0.17, 0.0).cells_cleared, 1u);
  EXPECT_FALSE(At(2.1, 0.1).known());
}

TEST_P(ClearingTest, TheFlatTopOfWhatWentAwayIsCleared) {
  // A van's roof, wider than the neighbourhood of a plane fit: its middle is annotated as free.
  const auto on_roof = [](double x_m, double y_m) {
    return x_m > 1.6 && x_m < 3.2 && std::fabs(y_m) < 0.8;
  };
  PointScan van(2.5);
  van.AddCells(kAround, 0.2, [&](double x_m, double y_m) { return on_roof(x_m, y_m) ? 1.9 : 0.0; });
  van.scan().noise = {.along_beam = true, .axial_m = {0.02f, 0, 0}, .lateral_m = {0.02f, 0}};
  Fuse(van.At(1));
  ASSERT_GT(At(2.3, 0.1).traversability, options_.traversability_free);
  PointScan ground(2.5);
  for (double x_m = 1.65; x_m < 6; x_m += 0.05) {
    for (double y_m = -2; y_m < 2; y_m += 0.02) ground.Add(x_m, y_m, 0);
  }
  ground.scan().noise = van.scan().noise;
  Fuse(ground.At(2));
  for (std::size_t i = 0; i < map_.num_cells(); ++i) EXPECT_LT(map_.elevation_m[i], 0.1f) << i;
}

TEST_P(ClearingTest, PointsOverTheHeightWindowAreRaysAndReflectionsAreNot) {
  Plant(2.1, 0.1);
  PointScan reflection(Pose<Odom, Base>(), Pose<Base, Sensor>::FromTranslation(0, 0, 1.7));
  reflection.Add(20, 0.9, -10.5);
  EXPECT_EQ(Fuse(reflection.At(3)).cells_cleared, 0u);
  // A sensor near the ground sees the top of a house over the post's place, 0.4 m high there.
  PointScan low(Pose<Odom, Base>(), Pose<Base, Sensor>::FromTranslation(0, 0, 0.1));
  low.Add(30, 1.4, 4.0);
  const ScanReport report = Fuse(low.At(4));
  EXPECT_EQ(report.points_out_of_height, 1u);
  EXPECT_EQ(report.cells_cleared, 1u);
}

TEST_P(ClearingTest, TheCellOfTheSensorIsNeverCleared) {
  PointScan scan(1.7);
  scan.Add(0.1, 0.1, 2.5);
  Fuse(scan.At(1));
  PointScan rays(Pose<Odom, Base>(), Pose<Base, Sensor>::FromTranslation(0.1, 0.1, 1.7));
  for (int i = 0; i < 360; ++i) {
    const double angle_rad = i * std::numbers::pi / 180;
    rays.Add(0.1 + 4 * std::cos(angle_rad), 0.1 + 4 * std::sin(angle_rad), 0);
  }
  EXPECT_EQ(Fuse(rays.At(2)).cells_cleared, 0u);
  EXPECT_FLOAT_EQ(At(0.1, 0.1).elevation_m, 2.5f);
}

}  // namespace
}  // namespace gem
