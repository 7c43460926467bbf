#include "core/local/fuse.h"

#include <gtest/gtest.h>

#include <vector>

namespace gem {
namespace {

constexpr Rgba kRed = 0xff0000ffu;
constexpr Rgba kBlue = 0xffff0000u;

FuseLimits Limits() { return FuseLimitsOf(LocalMapOptions()); }

CellFusion Known(float elevation_m, float variance_m2) {
  return UnpackCell({elevation_m, variance_m2}, 0);
}

// Not inlined: g++ 12 sees out-of-bounds reads in vectors of one where there are none.
[[gnu::noinline]] FuseOutcome Fuse(CellFusion& cell, const std::vector<Hit>& hits,
                                   bool traversable = false, float pose_m2 = 0) {
  return FuseCell(cell, hits.data(), static_cast<std::uint32_t>(hits.size()), traversable, pose_m2,
                  Limits());
}

TEST(FuseHeight, AveragesEquallySureHeights) {
  const Height fused = FuseHeight({1.0f, 0.02f}, {2.0f, 0.02f});
  EXPECT_FLOAT_EQ(fused.elevation_m, 1.5f);
  EXPECT_FLOAT_EQ(fused.variance_m2, 0.01f);
}

// The original fused without parentheses: v_e e_g + v_g e / (v_g + v_e).
TEST(FuseHeight, WeighsByInverseVariance) {
  const Height fused = FuseHeight({1.0f, 0.03f}, {2.0f, 0.01f});
  EXPECT_FLOAT_EQ(fused.elevation_m, 1.75f);    // (0.01 * 1 + 0.03 * 2) / 0.04
  EXPECT_FLOAT_EQ(fused.variance_m2, 0.0075f);  // 0.03 * 0.01 / 0.04
}

TEST(FuseHeight, TwoPerfectHeightsMeetInTheMiddle) {
  const Height fused = FuseHeight({1.0f, 0.0f}, {2.0f, 0.0f});
  EXPECT_EQ(fused.elevation_m, 1.5f);
  EXPECT_EQ(fused.variance_m2, 0.0f);
}

// A cell before the scan's first point has passed.
bool Passes(Height cell, Height z, const FuseLimits& limits, float pose_m2 = 0) {
  return PassesGate(ScanFusion{UnpackCell(cell, 0), CellFusion(), pose_m2}, z, limits);
}

TEST(Gate, AddsTheVariancesOfCellAndPoint) {
  // sqrt(0.0016 + 0.0009) = 0.05: three sigmas are 0.15 m.
  EXPECT_TRUE(Passes({1, 0.0016f}, {1.149f, 0.0009f}, Limits()));
  EXPECT_FALSE(Passes({1, 0.0016f}, {1.151f, 0.0009f}, Limits()));
  EXPECT_TRUE(Passes({1, 0.0016f}, {0.851f, 0.0009f}, Limits()));
  EXPECT_FALSE(Passes({1, 0.0016f}, {0.849f, 0.0009f}, Limits()));
}

TEST(Gate, TakesNoCellForSurerThanTheFloor) {
  // With the floor of 1e-4 m^2 three sigmas are 0.03 m.
  EXPECT_TRUE(Passes({1, 0}, {1.0299f, 0}, Limits()));
  EXPECT_FALSE(Passes({1, 0}, {1.0301f, 0}, Limits()));
}

TEST(Gate, AddsTheErrorOfThePose) {
  // sqrt(0.0016 + 0.0009 + 0.0075) = 0.1: three sigmas are 0.3 m.
  EXPECT_TRUE(Passes({1, 0.0016f}, {1.299f, 0.0009f}, Limits(), 0.0075f));
  EXPECT_FALSE(Passes({1, 0.0016f}, {1.301f, 0.0009f}, Limits(), 0.0075f));
}

TEST(Gate, TheErrorOfThePoseCancelsWithinAScan) {
  // The cell comes from this scan alone, so the unsure pose lifts both points alike.
  const CellFusion scan = UnpackCell({1, 1e-4f}, 0);
  const ScanFusion cell{CellFusion(), scan, /*pose_m2=*/1.0f};
  EXPECT_TRUE(PassesGate(cell, {1.042f, 1e-4f}, Limits()));
  EXPECT_FALSE(PassesGate(cell, {1.043f, 1e-4f}, Limits()));
}

TEST(FuseCell, ManyPointsOfAnUnsurePoseWeighNoMoreThanThePose) {
  // A hundred points of 1e-6 m^2 from a pose that is as unsure as the cell meet it in the middle.
  CellFusion cell = Known(1, 0.01f);
  Fuse(cell, std::vector<Hit>(100, Hit{{1.1f, 1e-6f}}), true, 0.01f);
  EXPECT_NEAR(cell.height.elevation_m, 1.05, 1e-4);
  EXPECT_NEAR(cell.height.variance_m2, 0.005, 1e-6);
}

TEST(FuseCell, WithoutAPriorThePoseAddsItsVarianceOnce) {
  CellFusion cell;
  Fuse(cell, {{{1.0f, 0.02f}}, {{1.0f, 0.02f}}}, false, 0.04f);
  EXPECT_FLOAT_EQ(cell.height.variance_m2, 0.05f);  // 0.02 / 2 + 0.04
}

TEST(FuseCell, AnUnknownCellBeginsFromTheHighestPoint) {
  CellFusion cell;
  // 0.2 m lies far below the gate of 1.0 m; 0.99 m is within it.
  const FuseOutcome outcome = Fuse(cell, {{{0.2f, 1e-4f}}, {{1.0f, 1e-4f}}, {{0.99f, 1e-4f}}});
  EXPECT_TRUE(cell.known);
  EXPECT_FLOAT_EQ(cell.height.elevation_m, 0.995f);
  EXPECT_EQ(outcome.fused, 2u);
  EXPECT_EQ(outcome.gated, 1u);
  EXPECT_FALSE(outcome.restarted);
}

TEST(FuseCell, ThePointThatBeginsACellCountsOnce) {
  CellFusion cell;
  Fuse(cell, {{{1.0f, 0.01f}}});
  EXPECT_EQ(cell.height.elevation_m, 1.0f);
  EXPECT_EQ(cell.height.variance_m2, 0.01f);  // half of it had it been fused with itself
}

TEST(FuseCell, RestartsFromAPointAboveTheGate) {
  CellFusion cell = Known(0, 1e-4f);
  const FuseOutcome outcome = Fuse(cell, {{{0.0f, 1e-4f}}, {{0.5f, 2e-4f}}});
  EXPECT_EQ(cell.height.elevation_m, 0.5f);
  EXPECT_EQ(cell.height.variance_m2, 2e-4f);
  EXPECT_TRUE(outcome.restarted);
  EXPECT_EQ(outcome.fused, 1u);
  EXPECT_EQ(outcome.gated, 1u);
}

TEST(FuseCell, LowerPointsSayNothingInAnObstacleCell) {
  CellFusion cell = Known(1, 1e-4f);
  const FuseOutcome outcome = Fuse(cell, {{{0.3f, 1e-4f}}, {{0.6f, 1e-4f}}});
  EXPECT_EQ(cell.height.elevation_m, 1.0f);
  EXPECT_EQ(cell.height.variance_m2, 1e-4f);
  EXPECT_EQ(outcome.gated, 2u);
  EXPECT_FALSE(outcome.inflated);
}

TEST(FuseCell, ATraversableCellSeenBelowTheGateBecomesLessSure) {
  CellFusion cell = Known(1, 1e-4f);
  const FuseOutcome outcome = Fuse(cell, {{{0.6f, 1e-4f}}}, /*traversable=*/true);
  EXPECT_EQ(cell.height.elevation_m, 1.0f);
  EXPECT_FLOAT_EQ(cell.height.variance_m2, 4e-4f);
  EXPECT_TRUE(outcome.inflated);
  EXPECT_EQ(outcome.gated, 1u);
}

TEST(FuseCell, KeepsVarianceBetweenFloorAndCap) {
  CellFusion sure = Known(1, 1e-4f);
  Fuse(sure, {{{1.0f, 1e-5f}}});
  EXPECT_EQ(sure.height.variance_m2, 1e-4f);
  CellFusion unsure;
  Fuse(unsure, {{{1.0f, 50.0f}}});
  EXPECT_EQ(unsure.height.variance_m2, 1.0f);
  CellFusion inflated = Known(1, 0.5f);
  Fuse(inflated, {{{-5.0f, 1e-4f}}}, /*traversable=*/true);
  EXPECT_EQ(inflated.height.variance_m2, 1.0f);
}

TEST(FuseCell, PointsOfOneScanAreAveragedBeforeTheFloorApplies) {
  // Four points of 1e-5 m^2 that differ by 4 mm: were the floor applied after each, the last would
  // outweigh the others ten to one.
  CellFusion cell;
  Fuse(cell, {{{1.004f, 1e-5f}}, {{1.0f, 1e-5f}}, {{1.004f, 1e-5f}}, {{1.0f, 1e-5f}}});
  EXPECT_NEAR(cell.height.elevation_m, 1.002, 1e-6);
  EXPECT_EQ(cell.height.variance_m2, 1e-4f);
}

TEST(FuseCell, DependsOnTheOrderOfPointsOnly) {
  // 0.97 passes while the cell is at 1.0 m but not after 1.03 was fused... and the other way round.
  const Hit low{{0.972f, 1e-6f}}, high{{1.028f, 1e-6f}};
  CellFusion first = Known(1, 1e-4f), second = Known(1, 1e-4f);
  Fuse(first, {low, high});
  Fuse(second, {high, low});
  EXPECT_NEAR(first.height.elevation_m, 0.972, 1e-3);
  EXPECT_NEAR(second.height.elevation_m, 1.028, 1e-3);
}

TEST(Color, IsAveragedByVariance) {
  CellFusion cell;
  Fuse(cell, {{{1.0f, 0.03f}, kRed}, {{1.0f, 0.01f}, kBlue}});
  // Gain 0.75: red 63.75, blue 191.25.
  EXPECT_EQ(PackColor(cell), 0xffbf0040u);
}

TEST(Color, OfAScanIsAveragedWithThePriorByVariance) {
  CellFusion cell = UnpackCell({1, 0.03f}, kRed);
  Fuse(cell, {{{1.0f, 0.02f}, kBlue}, {{1.0f, 0.02f}, kBlue}});
  // The scan's variance is 0.01: gain 0.75.
  EXPECT_EQ(PackColor(cell), 0xffbf0040u);
}

TEST(Color, UncoloredPointsLeaveItAlone) {
  CellFusion cell = UnpackCell({1, 0.01f}, kRed);
  Fuse(cell, {{{1.0f, 0.01f}, 0}});
  EXPECT_EQ(PackColor(cell), kRed);
}

TEST(Color, TheFirstIsTakenWhole) {
  CellFusion cell = Known(1, 1e-4f);
  Fuse(cell, {{{1.0f, 1.0f}, kBlue}});
  EXPECT_EQ(PackColor(cell), kBlue);
}

TEST(Color, ARestartForgetsIt) {
  CellFusion cell = UnpackCell({1, 1e-4f}, kRed);
  Fuse(cell, {{{2.0f, 1e-4f}, 0}});
  EXPECT_EQ(PackColor(cell), 0u);
}

TEST(Growth, IsRateTimesTheWay) {
  LocalMapOptions options;
  options.variance_growth_m2_per_s = 0;
  options.variance_growth_m2_per_m = 2e-3f;
  EXPECT_FLOAT_EQ(GrowthOver(0, 1'000'000'000, 1.5, options), 3e-3f);
}

TEST(Growth, IsRateTimesTimeUpToTheCap) {
  LocalMapOptions options;
  options.variance_growth_m2_per_s = 1e-3f;
  options.variance_growth_m2_per_m = 0;
  EXPECT_FLOAT_EQ(GrowthOver(1'000'000'000, 3'500'000'000, 100, options), 2.5e-3f);
  EXPECT_FLOAT_EQ(GrowVariance(1e-3f, 2.5e-3f, Limits()), 3.5e-3f);
  EXPECT_EQ(GrowVariance(0.9f, 0.2f, Limits()), 1.0f);
}

}  // namespace
}  // namespace gem
