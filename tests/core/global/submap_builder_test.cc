#include "core/global/submap_builder.h"

#include <gtest/gtest.h>

#include <cmath>
#include <set>

#include "scenes.h"

namespace gem {
namespace {

using test::kSecond_ns;

EvictedCell Evicted(std::int32_t x, std::int32_t y, float elevation_m, std::int64_t stamp_ns,
                    float traversability = 1.0f, float variance_m2 = 0.01f) {
  return {{x, y},
          {elevation_m, variance_m2, traversability, 0, stamp_ns, kCellKnown | kCellAnnotated}};
}

Pose<Odom, Base> At(double x_m, double y_m, double z_m = 0) {
  return Pose<Odom, Base>::FromTranslation(x_m, y_m, z_m);
}

GlobalMapOptions Options() {
  GlobalMapOptions options;
  options.cell_size_m = 0.25f;  // exact in binary: numbers below are exact
  options.submap_length_m = 20;
  return options;
}

TEST(SubmapBuilder, AnchorsOnACellCornerWithTheAxesOfO) {
  SubmapBuilder builder("s", "r", Options());
  const Pose<Odom, Base> T_O_B = Pose<Odom, Base>::FromYaw(1.0, {10.3, -4.1, 1.234});
  builder.Add(7, T_O_B, {}, {Evicted(41, -17, 2.0f, 5)});
  const auto submap = builder.ActiveSnapshot();
  ASSERT_NE(submap, nullptr);
  // 10.3 / 0.25 = 41.2; -4.1 / 0.25 = -16.4 rounds down to -17; 1.234 * 64 = 78.98.
  EXPECT_EQ(submap->origin().T_O_K.translation(), Eigen::Vector3d(10.25, -4.25, 79.0 / 64));
  EXPECT_TRUE(submap->origin().T_O_K.matrix().isIdentity(0));
  EXPECT_EQ(submap->origin().anchor_stamp_ns, 7);
  EXPECT_EQ(submap->origin().robot, "r");
  EXPECT_EQ(submap->sources(), (Sources{{{"s", "r"}}}));
  // Cell (41, -17) of O is cell (0, 0) of K: one to one.
  const auto position = submap->Find({0, 0});
  ASSERT_TRUE(position.has_value());
  EXPECT_EQ(submap->elevation_m(*position), 2.0f - 79.0f / 64);
}

TEST(SubmapBuilder, CellsEnterTheSubmapThatWasActiveWhenTheyLeft) {
  SubmapBuilder builder("s", "r", Options());
  EXPECT_EQ(builder.Add(0, At(0, 0), {}, {}), nullptr);
  EXPECT_EQ(builder.Add(1, At(19.9, 0), {}, {Evicted(1, 0, 0, 1)}), nullptr);
  // This step ends the submap; what it evicts still belongs to it.
  const auto finished = builder.Add(2, At(20.0, 0), {}, {Evicted(2, 0, 0, 2)});
  ASSERT_NE(finished, nullptr);
  EXPECT_EQ(finished->num_cells(), 2u);
  EXPECT_EQ(finished->origin().anchor_stamp_ns, 0);
  EXPECT_EQ(builder.ActiveSnapshot(), nullptr);
  builder.Add(3, At(20.1, 0), {}, {Evicted(3, 0, 0, 3)});
  EXPECT_EQ(builder.ActiveSnapshot()->origin().anchor_stamp_ns, 2);
  EXPECT_EQ(builder.ActiveSnapshot()->origin().T_O_K.translation().x(), 20.0);
}

TEST(SubmapBuilder, LengthIsPathAndNotDistance) {
  SubmapBuilder builder("s", "r", Options());
  builder.Add(0, At(0, 0), {}, {Evicted(0, 0, 0, 0)});
  EXPECT_EQ(builder.Add(1, At(10, 0), {}, {}), nullptr);
  EXPECT_NE(builder.Add(2, At(0, 0), {}, {}), nullptr) << "10 m there and 10 m back are 20 m";
}

TEST(SubmapBuilder, ASubmapWithoutCellsIsReanchored) {
  SubmapBuilder builder("s", "r", Options());
  builder.Add(0, At(0, 0), {}, {});
  EXPECT_EQ(builder.Add(1, At(25, 0), {}, {}), nullptr);
  builder.Add(2, At(26, 0), {}, {Evicted(100, 0, 0, 2)});
  EXPECT_EQ(builder.ActiveSnapshot()->origin().anchor_stamp_ns, 1);
}

TEST(SubmapBuilder, FinishHandsOutTheRestAndStartsAfresh) {
  SubmapBuilder builder("s", "r", Options());
  EXPECT_EQ(builder.Finish({}), nullptr);
  builder.Add(0, At(0, 0), {}, {Evicted(0, 0, 0, 0)});
  const auto finished = builder.Finish({Evicted(1, 0, 0, 1)});
  ASSERT_NE(finished, nullptr);
  EXPECT_EQ(finished->num_cells(), 2u);
  EXPECT_EQ(builder.Finish({}), nullptr);
  builder.Add(9, At(5, 5), {}, {Evicted(20, 20, 0, 9)});
  EXPECT_EQ(builder.ActiveSnapshot()->origin().anchor_stamp_ns, 9);
}

TEST(SubmapBuilder, CovarianceFollowsEquations8To11) {
  SubmapBuilder builder("s", "r", Options());
  AnchorCovariance covariance;
  covariance.rotation_rad2 = Eigen::Vector3d(1e-4, 2e-4, 3e-4).asDiagonal();
  covariance.translation_m2 = Eigen::Vector3d(0.01, 0.02, 0.03).asDiagonal();
  // The robot looks along y: its x axis is y of O, its y axis is -x of O.
  const Pose<Odom, Base> T_O_B = Pose<Odom, Base>::FromYaw(M_PI / 2, {0.125, 0.125, 0});
  builder.Add(0, T_O_B, covariance, {});
  // Middle of cell (8, 0): 2 m to the right of the robot along x of O, 1 m above it.
  builder.Add(1, T_O_B, covariance, {Evicted(8, 0, 1.0f, 1, 1.0f, 0.5f)});
  const auto submap = builder.ActiveSnapshot();
  const Covariance3 c = submap->covariance_m2(*submap->Find({8, 0}));
  // In the axes of O: Sigma_phi = diag(2e-4, 1e-4, 3e-4); lever v = (2, 0, 1).
  // [v]x = [0 -1 0; 1 0 -2; 0 2 0]; [v]x Sigma [v]x^T:
  //   xx = 1e-4, xz = -2e-4, yy = 2e-4 + 4 * 3e-4 = 14e-4, zz = 4 * 1e-4.
  const float place = 0.25f * 0.25f / 12;
  EXPECT_NEAR(c[0], 1e-4 + place + 0.01, 1e-7);
  EXPECT_NEAR(c[1], 0, 1e-7);
  EXPECT_NEAR(c[2], -2e-4, 1e-7);
  EXPECT_NEAR(c[3], 14e-4 + place + 0.02, 1e-7);
  EXPECT_NEAR(c[4], 0, 1e-7);
  EXPECT_NEAR(c[5], 4e-4 + 0.5 + 0.03, 1e-6);
}

TEST(SubmapBuilder, ACellThatComesBackIsFusedIfItAgrees) {
  SubmapBuilder builder("s", "r", Options());
  builder.Add(0, At(0, 0), {}, {Evicted(0, 0, 1.0f, 1 * kSecond_ns, 1.0f, 0.01f)});
  builder.Add(1, At(0, 0), {}, {Evicted(0, 0, 1.3f, 2 * kSecond_ns, 1.0f, 0.02f)});
  const auto submap = builder.ActiveSnapshot();
  EXPECT_EQ(submap->num_cells(), 1u);
  // (2 * 1.0 + 1 * 1.3) / 3 = 1.1; variance 0.01 * 0.02 / 0.03.
  EXPECT_NEAR(submap->At(0).elevation_m, 1.1f, 1e-6);
  EXPECT_NEAR(submap->At(0).covariance_m2[5], 0.02 / 3, 1e-7);
  EXPECT_EQ(submap->At(0).stamp_ns, 2 * kSecond_ns);
}

TEST(SubmapBuilder, ACellThatComesBackReplacesWhatItContradicts) {
  SubmapBuilder builder("s", "r", Options());
  builder.Add(0, At(0, 0), {}, {Evicted(0, 0, 1.8f, kSecond_ns, 0.1f, 0.01f)});
  builder.Add(1, At(0, 0), {}, {Evicted(0, 0, 0.0f, 2 * kSecond_ns, 1.0f, 0.01f)});
  EXPECT_EQ(builder.ActiveSnapshot()->At(0).elevation_m, 0.0f);
  EXPECT_EQ(builder.ActiveSnapshot()->At(0).traversability, 1.0f);
}

TEST(SubmapBuilder, TraversableOnlyDropsObstaclesAndWhatTheyStandOn) {
  GlobalMapOptions options = Options();
  options.traversable_only = true;
  SubmapBuilder builder("s", "r", options);
  EvictedCell bare = Evicted(3, 0, 0, 1);
  bare.belief.state = kCellKnown;  // never annotated: not known to be free
  builder.Add(
      0, At(0, 0), {},
      {Evicted(0, 0, 0, 1, 0.9f), Evicted(1, 0, 0, 1, 0.7f), Evicted(2, 0, 0, 1, 0.71f), bare});
  EXPECT_EQ(builder.ActiveSnapshot()->num_cells(), 2u) << "0.7 is not above 0.7";
  // Free before, an obstacle now: it must not stay free.
  builder.Add(1, At(0, 0), {}, {Evicted(0, 0, 1, 2, 0.1f)});
  EXPECT_FALSE(builder.ActiveSnapshot()->Find({0, 0}).has_value());
}

TEST(SubmapBuilder, EveryEvictedCellEndsUpInExactlyOneSubmap) {
  GlobalMapOptions options = Options();
  options.submap_length_m = 5;
  SubmapBuilder builder("s", "r", options);
  std::multiset<CellIndex> seen;
  const auto count = [&](const std::shared_ptr<const Submap>& submap) {
    if (submap == nullptr) return;
    const Eigen::Vector3d t = submap->origin().T_O_K.translation();
    const CellIndex corner = CellAt(t.x(), t.y(), 0.25);
    for (const KeyedSubmapCell& c : submap->Cells())
      seen.insert({c.cell.x + corner.x, c.cell.y + corner.y});
  };
  for (int step = 0; step < 1000; ++step) {
    std::vector<EvictedCell> column;
    for (std::int32_t y = -16; y < 16; ++y) column.push_back(Evicted(step - 16, y, 0, step));
    count(builder.Add(step, At(step * 0.25, 0), {}, column));
  }
  count(builder.Finish({Evicted(5000, 0, 0, 1000)}));
  EXPECT_EQ(seen.size(), 1000u * 32 + 1);
  EXPECT_EQ(std::set<CellIndex>(seen.begin(), seen.end()).size(), seen.size());
}

TEST(SubmapBuilder, OdometryThatJumpsDoesNotMakeASubmapOfAbsurdExtent) {
  GlobalMapOptions options = Options();
  options.submap_length_m = 10000;
  SubmapBuilder builder("s", "r", options);
  builder.Add(0, At(0, 0), {}, {Evicted(0, 0, 0, 0)});
  // 9 km away: less path than the length, more cells than a submap may be wide.
  const auto finished = builder.Add(1, At(9000, 0), {}, {Evicted(1, 0, 0, 0)});
  ASSERT_NE(finished, nullptr);
  EXPECT_EQ(finished->num_cells(), 2u);
  builder.Add(2, At(9000, 0), {}, {Evicted(36000, 0, 0, 0)});
  EXPECT_EQ(builder.ActiveSnapshot()->rect().min, (CellIndex{0, 0}));
}

}  // namespace
}  // namespace gem
