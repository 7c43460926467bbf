#include "client/evaluation/revisits.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <vector>

namespace gem::evaluation {
namespace {

constexpr std::int64_t kSecond_ns = 1'000'000'000;

std::vector<Pose<Global, Base>> Poses(const std::vector<double>& x_m) {
  std::vector<Pose<Global, Base>> poses;
  for (const double x : x_m) poses.push_back(Pose<Global, Base>::FromTranslation(x, 0, 0));
  return poses;
}

TEST(LoopClosures, AreNearAPlaceOfLongAgo) {
  const std::vector<std::int64_t> stamps_ns = {0, 30 * kSecond_ns, 61 * kSecond_ns, 92 * kSecond_ns,
                                               123 * kSecond_ns};
  // Scan 1 is near scan 0, but too soon; scan 3 is back at scan 1 after 62 s, scan 4 near scan 0.
  const auto poses = Poses({0, 4, 50, 5, 1});
  EXPECT_EQ(LoopClosures(poses, stamps_ns, {.scans_between = 1}), (std::vector<std::size_t>{3, 4}));
  EXPECT_EQ(LoopClosures(poses, stamps_ns, {.scans_between = 2}), (std::vector<std::size_t>{3}));
}

// 10 x 10 free cells at one height over K.
std::shared_ptr<const Submap> Plate(float elevation_m, std::int64_t stamp_ns,
                                    float traversability = 1.0f) {
  std::vector<KeyedSubmapCell> cells;
  for (std::int32_t y = 0; y < 10; ++y)
    for (std::int32_t x = 0; x < 10; ++x) {
      SubmapCell cell;
      cell.elevation_m = elevation_m;
      cell.traversability = traversability;
      cell.stamp_ns = stamp_ns;
      cell.state = kCellKnown | kCellAnnotated;
      cells.push_back({{x, y}, cell});
    }
  SubmapOrigin origin;
  origin.cell_size_m = 0.5f;
  origin.anchor_stamp_ns = stamp_ns;
  return std::make_shared<const Submap>(origin, cells);
}

TEST(PassedTwice, ComparesFreeCellsOfTwoPasses) {
  // The later pass lies four cells to the right and 3 cm higher: 6 x 10 cells are seen twice.
  const std::vector<LaidSubmap> laid = {
      {Plate(1.0f, kSecond_ns), {}},
      {Plate(1.0f, 100 * kSecond_ns), Pose<Global, Submap>::FromTranslation(2.0, 0, 0.03)}};
  const auto twice = PassedTwice(laid, 0.5, 60, 0.7f);
  ASSERT_EQ(twice.size(), 60u);
  EXPECT_NEAR(DeviationOf(twice).rms_m, 0.03, 1e-6);
  EXPECT_TRUE(PassedTwice(laid, 0.5, 120, 0.7f).empty());
}

TEST(PassedTwice, LeavesObstaclesOut) {
  const std::vector<LaidSubmap> laid = {{Plate(1.0f, kSecond_ns), {}},
                                        {Plate(1.5f, 100 * kSecond_ns, 0.2f), {}}};
  EXPECT_TRUE(PassedTwice(laid, 0.5, 60, 0.7f).empty());
}

TEST(DeviationOf, CountsAbsoluteDifferences) {
  const Deviation deviation = DeviationOf(std::vector<double>{0.03, -0.04, 0.0});
  EXPECT_EQ(deviation.cells, 3u);
  EXPECT_NEAR(deviation.rms_m, std::sqrt(0.0025 / 3), 1e-12);
  EXPECT_NEAR(deviation.median_m, 0.03, 1e-12);
  EXPECT_EQ(DeviationOf(std::vector<double>()).cells, 0u);
}

}  // namespace
}  // namespace gem::evaluation
