#include "client/simulation/town.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <vector>

namespace gem {
namespace {

// Twice round a circle of 40 m; the ground swings by 2 m, and the second round says it is 0.4 m
// higher, as a drifting recording would.
std::vector<Eigen::Vector3d> TwoRounds() {
  std::vector<Eigen::Vector3d> way_m;
  for (int i = 0; i < 600; ++i) {
    const double angle_rad = 4 * std::numbers::pi * i / 600;
    way_m.push_back({40 * std::cos(angle_rad), 40 * std::sin(angle_rad),
                     std::sin(angle_rad) + (i < 300 ? 0.0 : 0.4)});
  }
  return way_m;
}

TEST(Town, GroundLiesBetweenTheHeightsOfTwoPasses) {
  const auto town = BuildTown(TwoRounds(), {});
  for (int i = 0; i < 36; ++i) {
    const double angle_rad = 2 * std::numbers::pi * i / 36;
    const auto height_m =
        town->ground().HeightAt(40 * std::cos(angle_rad), 40 * std::sin(angle_rad));
    ASSERT_TRUE(height_m);
    EXPECT_NEAR(*height_m, std::sin(angle_rad) + 0.2, 0.05);
  }
}

TEST(Town, GroundEndsAtItsReach) {
  const auto town = BuildTown(TwoRounds(), {.reach_m = 10});
  EXPECT_TRUE(town->ground().HeightAt(48, 0));
  EXPECT_FALSE(town->ground().HeightAt(0, 0));
}

TEST(Town, NothingStandsOnTheWay) {
  const auto town = BuildTown(TwoRounds(), {});
  EXPECT_GT(town->boxes().size(), 100u);
  EXPECT_GT(town->cylinders().size(), 5u);
  for (const Eigen::Vector3d& place_m : TwoRounds())
    for (const double aside_m : {-1.5, 0.0, 1.5}) {
      const Eigen::Vector2d at_m = (1 + aside_m / 40) * place_m.head<2>();
      for (const Box& box : town->boxes()) EXPECT_FALSE(Covers(box, at_m));
      for (const Cylinder& cylinder : town->cylinders()) EXPECT_FALSE(Covers(cylinder, at_m));
    }
}

// Half the way knows both passes of its first half: the street is furnished once.
TEST(Town, AStreetDrivenTwiceIsFurnishedOnce) {
  const std::vector<Eigen::Vector3d> twice_m = TwoRounds();
  const std::vector<Eigen::Vector3d> once_m(twice_m.begin(), twice_m.begin() + 310);
  const auto twice = BuildTown(twice_m, {})->boxes().size();
  const auto once = BuildTown(once_m, {})->boxes().size();
  EXPECT_NEAR(static_cast<double>(twice), static_cast<double>(once), 10);
}

TEST(Town, TheSameWayAndSeedGiveTheSameTown) {
  const auto a = BuildTown(TwoRounds(), {.seed = 5});
  const auto b = BuildTown(TwoRounds(), {.seed = 5});
  const auto other = BuildTown(TwoRounds(), {.seed = 6});
  ASSERT_EQ(a->boxes().size(), b->boxes().size());
  for (std::size_t i = 0; i < a->boxes().size(); ++i)
    EXPECT_EQ(a->boxes()[i].center_m, b->boxes()[i].center_m);
  EXPECT_NE(a->boxes().size(), other->boxes().size());
}

}  // namespace
}  // namespace gem
