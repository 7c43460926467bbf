#include "client/simulation/world.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <numbers>
#include <vector>

#include "client/simulation/analytic_terrain.h"
#include "client/simulation/random.h"
#include "client/simulation/ray_caster.h"

namespace gem {
namespace {

Ray RayFrom(double x, double y, double z, double dx, double dy, double dz) {
  return {{x, y, z}, Eigen::Vector3d(dx, dy, dz).normalized()};
}

std::unique_ptr<HeightField> LevelGround() {
  return std::make_unique<AnalyticTerrain>(GroundPlane{}, std::vector<Hill>{}, std::vector<Step>{});
}

TEST(Box, IsHitOnItsNearFace) {
  const Box box = MakeBox({10, 0}, {2, 4}, 0, 0, 3);
  EXPECT_NEAR(*Cast(RayFrom(0, 1, 1, 1, 0, 0), 100, box), 9.0, 1e-12);
  EXPECT_NEAR(*Cast(RayFrom(10, 0, 5, 0, 0, -1), 100, box), 2.0, 1e-12);
  EXPECT_FALSE(Cast(RayFrom(0, 2.1, 1, 1, 0, 0), 100, box));
  EXPECT_FALSE(Cast(RayFrom(0, 1, 3.1, 1, 0, 0), 100, box));
  EXPECT_FALSE(Cast(RayFrom(0, 1, 1, -1, 0, 0), 100, box));
  EXPECT_FALSE(Cast(RayFrom(0, 1, 1, 1, 0, 0), 8.9, box));
}

TEST(Box, TurnedByAnEighthShowsItsEdge) {
  // A cube of side 2: its edge is sqrt(2) before its middle.
  const Box box = MakeBox({10, 0}, {2, 2}, std::numbers::pi / 4, 0, 2);
  EXPECT_NEAR(*Cast(RayFrom(0, 0, 1, 1, 0, 0), 100, box), 10 - std::sqrt(2.0), 1e-12);
}

TEST(Box, RayFromInsideHitsAtOnce) {
  EXPECT_EQ(*Cast(RayFrom(10, 0, 1, 1, 0, 0), 100, MakeBox({10, 0}, {2, 2}, 0, 0, 2)), 0.0);
}

TEST(Wall, StandsBetweenItsEnds) {
  // From (0, 0) to (3, 4): its middle (1.5, 2) is covered, a point 0.2 m beside it is not.
  const Box wall = MakeWall({0, 0}, {3, 4}, 0.2, 0, 1);
  EXPECT_TRUE(Covers(wall, {1.5, 2}));
  EXPECT_TRUE(Covers(wall, {2.94, 3.92}));
  EXPECT_FALSE(Covers(wall, {3.06, 4.08}));
  EXPECT_FALSE(Covers(wall, {1.5 + 0.16, 2 - 0.12}));
}

TEST(Cylinder, IsHitOnItsNearSideAndOnItsLid) {
  const Cylinder cylinder{.center_m = {5, 0}, .radius_m = 2, .z_m_min = 0, .z_m_max = 1};
  EXPECT_NEAR(*Cast(RayFrom(0, 0, 0.5, 1, 0, 0), 100, cylinder), 3.0, 1e-12);
  // 1.2 m off its axis the chord begins 1.6 m before its middle.
  EXPECT_NEAR(*Cast(RayFrom(0, 1.2, 0.5, 1, 0, 0), 100, cylinder), 3.4, 1e-12);
  EXPECT_NEAR(*Cast(RayFrom(5, 1, 4, 0, 0, -1), 100, cylinder), 3.0, 1e-12);
  EXPECT_FALSE(Cast(RayFrom(0, 2.01, 0.5, 1, 0, 0), 100, cylinder));
  EXPECT_FALSE(Cast(RayFrom(5, 2.01, 4, 0, 0, -1), 100, cylinder));
  EXPECT_FALSE(Cast(RayFrom(0, 0, 1.01, 1, 0, 0), 100, cylinder));
}

TEST(Walker, WalksToTheEndOfHisPathAndBack) {
  const Walker walker{.path_m = {{0, 0}, {10, 0}, {10, 5}}, .speed_m_per_s = 2};
  EXPECT_EQ(walker.At(0), Eigen::Vector2d(0, 0));
  EXPECT_EQ(walker.At(2), Eigen::Vector2d(4, 0));
  EXPECT_EQ(walker.At(6), Eigen::Vector2d(10, 2));
  EXPECT_EQ(walker.At(7.5), Eigen::Vector2d(10, 5));
  EXPECT_EQ(walker.At(9), Eigen::Vector2d(10, 2));
  EXPECT_EQ(walker.At(15), Eigen::Vector2d(0, 0));
  EXPECT_EQ(walker.At(17), Eigen::Vector2d(4, 0));
}

TEST(World, RayFindsTheWalkerWhereHeIsAtThatTime) {
  World world(LevelGround());
  world.Add(Walker{.path_m = {{0, 5}, {100, 5}}, .speed_m_per_s = 1});
  // At second 20 he stands at (20, 5), 0.3 m thick: seen from (20, 0) at 4.7 m.
  const auto hit = world.Cast(RayFrom(20, 0, 1, 0, 1, 0), 50, 20.0);
  ASSERT_TRUE(hit);
  EXPECT_EQ(hit->kind, HitKind::kWalker);
  EXPECT_NEAR(hit->range_m, 4.7, 1e-12);
  EXPECT_FALSE(world.Cast(RayFrom(20, 0, 1, 0, 1, 0), 50, 21.0));
  EXPECT_FALSE(world.Cast(RayFrom(20, 0, 1.71, 0, 1, 0), 50, 20.0));
}

TEST(World, TrueHeightIsTheTopOfWhatStandsThere) {
  World world(LevelGround());
  world.Add(MakeBox({0, 0}, {2, 2}, 0, 0, 0.5));
  world.Add(Cylinder{.center_m = {0.9, 0}, .radius_m = 0.2, .z_m_min = 0, .z_m_max = 3});
  world.Add(Walker{.path_m = {{5, 0}}});
  EXPECT_EQ(*world.TrueHeightAt(-0.5, 0), 0.5);
  EXPECT_EQ(*world.TrueHeightAt(1.0, 0), 3.0);
  EXPECT_EQ(*world.TrueHeightAt(1.2, 0), 0.0);
  EXPECT_EQ(*world.TrueHeightAt(5, 0), 0.0);  // walkers do not count
}

TEST(World, FirstThingOnTheRayIsHit) {
  World world(LevelGround());
  world.Add(MakeBox({10, 0}, {1, 1}, 0, 0, 2));
  world.Add(MakeBox({5, 0}, {1, 1}, 0, 0, 1));
  const auto low = world.Cast(RayFrom(0, 0, 0.8, 1, 0, 0), 50, 0);
  EXPECT_EQ(low->index, 1u);
  const auto high = world.Cast(RayFrom(0, 0, 1.5, 1, 0, 0), 50, 0);
  EXPECT_EQ(high->index, 0u);
  EXPECT_EQ(world.Cast(RayFrom(0, 0, 1, 0, 1, -1), 50, 0)->kind, HitKind::kGround);
}

// Solids all round and above the place where the rays start, some of them around it.
TEST(RayCaster, AgreesWithAskingEverySolid) {
  Random random(11, 0);
  const auto between = [&](double low, double high) {
    return low + (high - low) * random.Uniform();
  };
  World world(std::make_unique<AnalyticTerrain>(
      GroundPlane{0, 0.01, 0}, std::vector<Hill>{{8, 8, 9, 2}}, std::vector<Step>{}));
  for (int i = 0; i < 60; ++i) {
    const Eigen::Vector2d place_m(between(-30, 30), between(-30, 30));
    world.Add(
        MakeBox(place_m, {between(0.2, 6), between(0.2, 6)}, between(-3, 3), -1, between(0.2, 4)));
    world.Add(Cylinder{.center_m = {between(-30, 30), between(-30, 30)},
                       .radius_m = between(0.1, 1),
                       .z_m_min = 2,
                       .z_m_max = 5});
    world.Add(Walker{
        .path_m = {{between(-20, 20), between(-20, 20)}, {between(-20, 20), between(-20, 20)}}});
  }
  std::size_t hits[4] = {0, 0, 0, 0};
  for (int place = 0; place < 10; ++place) {
    const Eigen::Vector3d origin_m(between(-20, 20), between(-20, 20), between(1, 6));
    const double time_s = between(0, 100);
    const RayCaster caster(world, origin_m, 40, time_s);
    for (int i = 0; i < 1000; ++i) {
      Eigen::Vector3d direction(between(-1, 1), between(-1, 1), between(-1, 1));
      if (i < 20) direction = Eigen::Vector3d::Unit(i % 3) * (i % 2 == 0 ? 1 : -1);
      direction.normalize();
      const auto expected = world.Cast({origin_m, direction}, 40, time_s);
      const auto hit = caster.Cast(direction);
      ASSERT_EQ(hit.has_value(), expected.has_value()) << place << " " << i;
      if (!hit) continue;
      EXPECT_NEAR(hit->range_m, expected->range_m, 1e-9);
      // From inside two solids both are hit at once.
      if (expected->range_m > 0) {
        EXPECT_EQ(hit->kind, expected->kind);
        EXPECT_EQ(hit->index, expected->index);
      }
      ++hits[static_cast<std::size_t>(hit->kind)];
    }
  }
  for (const std::size_t count : hits) EXPECT_GT(count, 100u);
}

}  // namespace
}  // namespace gem
