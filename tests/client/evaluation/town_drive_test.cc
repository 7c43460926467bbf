#include "client/evaluation/town_drive.h"

#include <gtest/gtest.h>

#include <vector>

#include "client/evaluation/revisits.h"
#include "client/evaluation/submap_run.h"

namespace gem::evaluation {
namespace {

TEST(BuildTownDrive, KeepsOdometrysErrorAgainstTheTruth) {
  const Drive before = RoundTheBlock(300, 0.8, /*drift_scale=*/3, /*seed=*/1);
  const TownDrive town = BuildTownDrive(before, 1);
  EXPECT_LT(town.lift_m_max, 0.3);
  for (std::size_t i = 0; i < before.size(); i += 50) {
    const auto error = before.odometry[i] * before.truth[i].Inverse();
    const auto error_on_ground = town.drive.odometry[i] * town.drive.truth[i].Inverse();
    EXPECT_LT((error.translation() - error_on_ground.translation()).norm(), 1e-9);
    const Eigen::Vector3d& place_m = town.drive.truth[i].translation();
    EXPECT_NEAR(place_m.z() - *town.town->ground().HeightAt(place_m.x(), place_m.y()), 1.73, 1e-9);
  }
}

TEST(CastScans, GivesEveryScanInOrderWhateverTheThreads) {
  const TownDrive town = BuildTownDrive(RoundTheBlock(70, 0.8, 0, 1), 1);
  const auto cast = [&town](int threads) {
    std::vector<std::vector<ScanPoint>> scans;
    CastScans(town, {.lidar = TownLidar(32), .threads = threads},
              [&](std::size_t i, std::span<const ScanPoint> points) {
                EXPECT_EQ(i, scans.size());
                scans.emplace_back(points.begin(), points.end());
              });
    return scans;
  };
  const auto one = cast(1);
  const auto two = cast(2);
  ASSERT_EQ(one.size(), 70u);
  ASSERT_EQ(two.size(), 70u);
  for (std::size_t i = 0; i < one.size(); ++i) {
    ASSERT_EQ(one[i].size(), two[i].size());
    EXPECT_GT(one[i].size(), 1000u);
    EXPECT_EQ(one[i].front().x_m, two[i].front().x_m);
  }
}

TEST(MapReplay, MapsTheTownWhereTheCorrectionPutsIt) {
  const TownDrive town = BuildTownDrive(RoundTheBlock(150, 0.8, /*drift_scale=*/5, 1), 1);
  LocalMapOptions local;
  auto recorder = *SubmapRecorder::Make(local, 20);
  CastScans(town, {.lidar = TownLidar(64)}, [&](std::size_t i, std::span<const ScanPoint> points) {
    recorder->Fuse(town.drive.stamps_ns[i], town.drive.odometry[i], points);
  });
  recorder->End();
  MapReplay replay(recorder->run(), {}, {});
  replay.TellUntil(town.drive.size());
  replay.Commit();
  const auto moved = replay.snapshot().version;
  ASSERT_TRUE(
      replay.Correct(CorrectionOf(recorder->run(), town.drive.corrected, town.drive.size())).ok());
  EXPECT_GT(replay.Commit().num_moved_submaps, 4u);
  EXPECT_NE(replay.snapshot().version, moved);
  const Deviation error = ErrorAgainst(replay.snapshot(), [&town](double x_m, double y_m) {
    return town.town->ground().HeightAt(x_m, y_m);
  });
  EXPECT_GT(error.cells, 1000u);
  EXPECT_LT(error.median_m, 0.05);
}

}  // namespace
}  // namespace gem::evaluation
