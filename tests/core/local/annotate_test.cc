#include "core/local/annotate.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

namespace gem {
namespace {

constexpr double kDegree_rad = std::numbers::pi / 180;

void Add(PlaneSums& sums, int dx, int dy, double height_m) {
  ColumnSums column;
  column.Add(dy, true, height_m);
  sums.Add(dx, column);
}

// The 5x5 neighbourhood of a height function of (x, y) in cells.
template <typename HeightOf>
Annotation AnnotateAll(const LocalMapOptions& options, HeightOf height_of) {
  PlaneSums sums;
  for (int dx = -2; dx <= 2; ++dx) {
    ColumnSums column;
    for (int dy = -2; dy <= 2; ++dy) column.Add(dy, true, height_of(dx, dy));
    sums.Add(dx, column);
  }
  return AnnotationOf(sums, options);
}

TEST(Slope, IsExactForFlatAndSteepPlanesAtAnyCellSizeAndHeading) {
  for (const float cell_size_m : {0.01f, 0.1f, 0.2f, 10.0f}) {
    LocalMapOptions options;
    options.cell_size_m = cell_size_m;
    for (const double slope_deg : {0.0, 0.001, 0.1, 11.0, 45.0, 60.0, 89.0, 89.9}) {
      for (const double heading_deg : {0.0, 30.0, 90.0, 200.0}) {
        const double rise = std::tan(slope_deg * kDegree_rad) * cell_size_m;
        const Annotation annotation = AnnotateAll(options, [&](int dx, int dy) {
          return rise * (dx * std::cos(heading_deg * kDegree_rad) +
                         dy * std::sin(heading_deg * kDegree_rad));
        });
        ASSERT_TRUE(annotation.valid);
        EXPECT_NEAR(annotation.slope_rad, slope_deg * kDegree_rad, 1e-6) << cell_size_m;
        EXPECT_NEAR(annotation.roughness_m, 0, 1e-6 + 1e-7 * rise);
      }
    }
  }
}

TEST(Slope, OfATangentAgreesWithTheLibrary) {
  EXPECT_EQ(AngleOfTangent(0), 0);
  for (float t = 1e-9f; t < 1e9f; t *= 1.37f)
    EXPECT_NEAR(AngleOfTangent(t), std::atan(t), 3e-7) << t;
}

TEST(Slope, NeedsEnoughCellsThatDoNotLieOnALine) {
  PlaneSums seven;
  for (int i = 0; i < 7; ++i) Add(seven, i % 3, i / 3, 0);
  EXPECT_FALSE(HasPlane(seven, 8));
  EXPECT_TRUE(HasPlane(seven, 7));
  PlaneSums line;
  for (int i = -2; i <= 2; ++i) Add(line, i, -i, i);
  EXPECT_FALSE(HasPlane(line, 3));
}

TEST(Slope, IgnoresTheHeightsOfUnknownCells) {
  PlaneSums with, without;
  for (int dx = -2; dx <= 2; ++dx) {
    ColumnSums some, all;
    for (int dy = -2; dy <= 2; ++dy) {
      if (dy != dx) some.Add(dy, true, 0.1 * dx);
      all.Add(dy, dy != dx, dy == dx ? 77.0 : 0.1 * dx);
    }
    without.Add(dx, some);
    with.Add(dx, all);
  }
  EXPECT_EQ(with.count, 20);
  EXPECT_NEAR(FitPlane(with).rise_x_m, 0.1, 1e-8);
  EXPECT_EQ(FitPlane(with).rise_x_m, FitPlane(without).rise_x_m);
}

TEST(Slope, ThreeCellsMakeAPlaneWithoutRoughness) {
  PlaneSums sums;
  Add(sums, 0, 0, 0);
  Add(sums, 1, 0, 0.1);
  Add(sums, 0, 1, 0);
  ASSERT_TRUE(HasPlane(sums, 3));
  const PlaneFit fit = FitPlane(sums);
  EXPECT_NEAR(fit.rise_x_m, 0.1, 1e-8);
  EXPECT_NEAR(fit.rise_y_m, 0.0, 1e-8);
  EXPECT_EQ(RoughnessOf(fit, sums.count), 0);
}

TEST(Roughness, IsTheDeviationOfHeightsAboutThePlane) {
  // A chess board of +-0.03 m: 13 cells up, 12 down, mean 0.0012 m, no slope. The squares about the
  // plane sum to 25 * (0.03^2 - 0.0012^2) m^2, over 22 degrees of freedom.
  const Annotation annotation = AnnotateAll(
      LocalMapOptions(), [](int dx, int dy) { return (dx + dy) % 2 == 0 ? 0.03 : -0.03; });
  EXPECT_NEAR(annotation.slope_rad, 0, 1e-6);
  EXPECT_NEAR(annotation.roughness_m, std::sqrt(25 * (0.0009 - 0.0012 * 0.0012) / 22), 1e-7);
}

TEST(Traversability, IsEquationSevenClampedToZero) {
  const LocalMapOptions options;
  EXPECT_FLOAT_EQ(TraversabilityOf(0, 0, options), 1.0f);
  EXPECT_FLOAT_EQ(TraversabilityOf(0.3f, 0.1f, options), 0.5f);  // 1 - 0.5 * 0.5 - 0.5 * 0.5
  EXPECT_EQ(TraversabilityOf(1.2f, 0.5f, options), 0.0f);
}

TEST(Traversability, ACurbIsAnObstacle) {
  // A step of 0.2 m between columns 0 and 1 of 0.2 m cells. Rise: (1 + 2) * 5 * 0.2 / 50 = 0.06 m a
  // cell, slope atan(0.3). Residuals by column 0.04, -0.02, -0.08, 0.06, 0, squares 0.06 m^2 in
  // all.
  const Annotation annotation =
      AnnotateAll(LocalMapOptions(), [](int dx, int) { return dx > 0 ? 0.2 : 0.0; });
  EXPECT_NEAR(annotation.slope_rad, std::atan(0.3), 1e-6);
  EXPECT_NEAR(annotation.roughness_m, std::sqrt(0.06 / 22), 1e-6);
  EXPECT_NEAR(annotation.traversability, 0.6266, 1e-4);  // below 0.7
}

TEST(Traversability, LidarNoiseOfTwoCentimetresIsFree) {
  std::mt19937 random(7);
  std::normal_distribution<double> noise_m(0, 0.02);
  for (int trial = 0; trial < 1000; ++trial) {
    const Annotation annotation =
        AnnotateAll(LocalMapOptions(), [&](int, int) { return noise_m(random); });
    EXPECT_GT(annotation.traversability, 0.8f);
  }
}

}  // namespace
}  // namespace gem
