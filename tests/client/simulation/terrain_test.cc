#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "client/simulation/analytic_terrain.h"
#include "client/simulation/grid_terrain.h"
#include "client/simulation/random.h"

namespace gem {
namespace {

AnalyticTerrain Plane(double height_m, double slope_x = 0, double slope_y = 0) {
  return {{height_m, slope_x, slope_y}, {}, {}};
}

Ray RayFrom(double x, double y, double z, double dx, double dy, double dz) {
  return {{x, y, z}, Eigen::Vector3d(dx, dy, dz).normalized()};
}

/// 3 x 3 heights, 2 m apart, the lower left one at (1, 1): 0 1 2 / 1 2 3 / 2 3 4 from the south.
EsriAsciiGrid Slope() {
  return {.columns = 3,
          .rows = 3,
          .x_m_min = 0,
          .y_m_min = 0,
          .cell_size_m = 2,
          .values = {0, 1, 2, 1, 2, 3, 2, 3, 4},
          .valid = std::vector<std::uint8_t>(9, 1)};
}

TEST(AnalyticTerrain, LevelPlaneIsHitWhereTriangleSays) {
  // 3 m over the plane, falling 3 for every 4 ahead: hit after 5 m.
  EXPECT_NEAR(*Plane(2).Cast(RayFrom(7, -4, 5, 4, 0, -3), 100), 5.0, 1e-12);
}

TEST(AnalyticTerrain, TiltedPlaneIsHitWhereLinesMeet) {
  // Ground z = 1 + x / 2; a level ray at z = 4 meets it at x = 6.
  EXPECT_NEAR(*Plane(1, 0.5).Cast(RayFrom(0, 3, 4, 1, 0, 0), 100), 6.0, 1e-12);
  // And never the other way.
  EXPECT_FALSE(Plane(1, 0.5).Cast(RayFrom(0, 3, 4, -1, 0, 0), 100));
}

TEST(AnalyticTerrain, NothingBeyondRangeIsHit) {
  const Ray down = RayFrom(0, 0, 10, 0, 0, -1);
  EXPECT_NEAR(*Plane(0).Cast(down, 10.01), 10.0, 1e-12);
  EXPECT_FALSE(Plane(0).Cast(down, 9.99));
}

TEST(AnalyticTerrain, RayThatRisesHitsNothing) {
  EXPECT_FALSE(Plane(0).Cast(RayFrom(0, 0, 1, 1, 0, 0.01), 1e4));
}

TEST(AnalyticTerrain, HillHasItsHeightInTheMiddleAndNoneAtItsEdge) {
  const AnalyticTerrain terrain({0, 0, 0}, {{10, 20, 4, 2}}, {});
  EXPECT_DOUBLE_EQ(*terrain.HeightAt(10, 20), 2.0);
  // Half way out: 2 (1 - 1/4)^2 = 1.125.
  EXPECT_DOUBLE_EQ(*terrain.HeightAt(12, 20), 1.125);
  EXPECT_DOUBLE_EQ(*terrain.HeightAt(10, 24), 0.0);
}

TEST(AnalyticTerrain, LevelRayMeetsHillAtItsContour) {
  // At height 1.125 the hill above is 2 m in radius; the ray comes from 10 m off its middle.
  const AnalyticTerrain terrain({0, 0, 0}, {{10, 20, 4, 2}}, {});
  EXPECT_NEAR(*terrain.Cast(RayFrom(0, 20, 1.125, 1, 0, 0), 100), 8.0, 1e-9);
  EXPECT_NEAR(*terrain.Cast(RayFrom(10, 30, 1.125, 0, -1, 0), 100), 8.0, 1e-9);
  // Over its top it goes on to the range limit.
  EXPECT_FALSE(terrain.Cast(RayFrom(0, 20, 2.001, 1, 0, 0), 100));
}

TEST(AnalyticTerrain, StepRisesAcrossItsRamp) {
  const AnalyticTerrain terrain({1, 0, 0}, {}, {{0, 5, 0.1, 0.2}});
  EXPECT_DOUBLE_EQ(*terrain.HeightAt(4.94, 7), 1.0);
  EXPECT_DOUBLE_EQ(*terrain.HeightAt(5.0, 7), 1.1);
  EXPECT_DOUBLE_EQ(*terrain.HeightAt(5.06, 7), 1.2);
  // A level ray half way up meets the middle of the ramp.
  EXPECT_NEAR(*terrain.Cast(RayFrom(0, 0, 1.1, 1, 0, 0), 100), 5.0, 1e-9);
}

TEST(AnalyticTerrain, EveryHitLiesOnSurfaceAndNothingIsPassedThrough) {
  const AnalyticTerrain terrain({0.3, 0.05, -0.02}, {{5, 3, 6, 1.5}, {9, -4, 5, -1}, {14, 6, 9, 3}},
                                {{0.4, 8, 0.3, 0.4}});
  Random random(7, 0);
  int hits = 0;
  for (int i = 0; i < 2000; ++i) {
    const double yaw_rad = 6.283185307179586 * random.Uniform();
    const Ray ray = RayFrom(20 * random.Uniform() - 5, 16 * random.Uniform() - 8, 6,
                            std::cos(yaw_rad), std::sin(yaw_rad), -0.6 * random.Uniform());
    const auto range_m = terrain.Cast(ray, 50);
    if (range_m) {
      ++hits;
      const Eigen::Vector3d p = ray.At(*range_m);
      EXPECT_NEAR(p.z(), *terrain.HeightAt(p.x(), p.y()), 1e-9);
    }
    // Coarse steps up to the hit: all over the ground.
    for (double before_m = 0; before_m < range_m.value_or(50) - 1e-6; before_m += 0.05) {
      const Eigen::Vector3d p = ray.At(before_m);
      ASSERT_GT(p.z(), *terrain.HeightAt(p.x(), p.y()) - 1e-6) << "ray " << i;
    }
  }
  EXPECT_GT(hits, 1500);
}

TEST(GridTerrain, HeightsAreBilinearBetweenMiddlesOfCells) {
  const GridTerrain terrain(Slope());
  EXPECT_DOUBLE_EQ(*terrain.HeightAt(1, 1), 0.0);
  EXPECT_DOUBLE_EQ(*terrain.HeightAt(5, 5), 4.0);
  EXPECT_DOUBLE_EQ(*terrain.HeightAt(2, 4), 2.0);  // 0.5 in x, 1.5 in y
  EXPECT_FALSE(terrain.HeightAt(0.99, 2));
  EXPECT_FALSE(terrain.HeightAt(2, 5.01));
}

TEST(GridTerrain, RayMeetsSlopeWhereLinesMeet) {
  // z = (x - 1) / 2 + (y - 1) / 2. Along y = 1, level at z = 1.5: x = 4. From x = -6: 10 m.
  const GridTerrain terrain(Slope());
  EXPECT_NEAR(*terrain.Cast(RayFrom(-6, 1, 1.5, 1, 0, 0), 100), 10.0, 1e-12);
  EXPECT_NEAR(*terrain.Cast(RayFrom(4.5, 3.5, 9, 0, 0, -1), 100), 6.0, 1e-12);
}

TEST(GridTerrain, TwistedPatchIsSolvedExactly) {
  // z = u v on [0, 1]^2; along the diagonal u = v = t, a ray at z = 0.25 meets it at t = 0.5.
  const GridTerrain terrain({.columns = 2,
                             .rows = 2,
                             .x_m_min = -0.5,
                             .y_m_min = -0.5,
                             .cell_size_m = 1,
                             .values = {0, 0, 0, 1},
                             .valid = {1, 1, 1, 1}});
  EXPECT_NEAR(*terrain.Cast(RayFrom(0, 0, 0.25, 1, 1, 0), 10), 0.5 * std::sqrt(2.0), 1e-12);
}

TEST(GridTerrain, PatchWithMissingCornerIsHole) {
  EsriAsciiGrid grid = Slope();
  grid.valid[8] = 0;
  const GridTerrain terrain(grid);
  EXPECT_FALSE(terrain.HeightAt(4, 4));
  EXPECT_FALSE(terrain.Cast(RayFrom(4, 4, 9, 0, 0, -1), 100));
  EXPECT_TRUE(terrain.HeightAt(2, 4));
}

TEST(GridTerrain, EveryHitLiesOnSurface) {
  EsriAsciiGrid grid;
  grid.columns = 40;
  grid.rows = 30;
  grid.x_m_min = -20;
  grid.y_m_min = -15;
  grid.cell_size_m = 1;
  Random random(3, 0);
  for (int i = 0; i < 1200; ++i) grid.values.push_back(static_cast<float>(random.Uniform()));
  grid.valid.assign(1200, 1);
  const GridTerrain terrain(grid);
  for (int i = 0; i < 2000; ++i) {
    const double yaw_rad = 6.283185307179586 * random.Uniform();
    const Ray ray = RayFrom(20 * random.Uniform() - 10, 16 * random.Uniform() - 8, 3,
                            std::cos(yaw_rad), std::sin(yaw_rad), -0.3 - random.Uniform());
    const auto range_m = terrain.Cast(ray, 60);
    if (!range_m) continue;
    const Eigen::Vector3d p = ray.At(*range_m);
    EXPECT_NEAR(p.z(), *terrain.HeightAt(p.x(), p.y()), 1e-9);
    for (double before_m = 0; before_m < *range_m - 1e-6; before_m += 0.05) {
      const Eigen::Vector3d q = ray.At(before_m);
      const auto height_m = terrain.HeightAt(q.x(), q.y());
      ASSERT_TRUE(!height_m || q.z() > *height_m - 1e-6) << "ray " << i;
    }
  }
}

}  // namespace
}  // namespace gem
