#include "core/global/terrain_reader.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "terrain_scenes.h"

namespace gem {
namespace {

using test::HeightOnly;
using test::Obstacle;
using test::TerrainScene;

GroundSample At(const TerrainScene& scene, double x_m, double y_m) {
  return TerrainReader(scene.map()).AtPlace({x_m, y_m});
}

TEST(TerrainReader, AnEmptyMapIsUnknown) {
  EXPECT_EQ(At(TerrainScene(), 3, -4), GroundSample());
  EXPECT_EQ(GroundSample().state, GroundState::kUnknown);
}

TEST(TerrainReader, TellsTheFourStatesApart) {
  TerrainScene scene;
  scene.FillFlat({{0, 0}, {4, 1}});
  scene.Set({1, 0}, Obstacle(0));
  scene.Set({2, 0}, HeightOnly(0));
  scene.Set({3, 0}, CellBelief());
  EXPECT_EQ(At(scene, 0.25, 0.25).state, GroundState::kFree);
  EXPECT_EQ(At(scene, 0.75, 0.25).state, GroundState::kObstacle);
  EXPECT_EQ(At(scene, 1.25, 0.25).state, GroundState::kHeightOnly);
  EXPECT_EQ(At(scene, 1.75, 0.25).state, GroundState::kUnknown);
}

// Exactly at the threshold is not above it.
TEST(TerrainReader, FreeIsAboveTheThreshold) {
  TerrainScene scene;
  scene.Set({0, 0}, Obstacle(0, 0.7f));
  scene.Set({1, 0}, Obstacle(0, std::nextafter(0.7f, 1.0f)));
  EXPECT_EQ(At(scene, 0.25, 0.25).state, GroundState::kObstacle);
  EXPECT_EQ(At(scene, 0.75, 0.25).state, GroundState::kFree);
}

TEST(TerrainReader, InterpolatesBetweenTheMiddlesOfFourCells) {
  TerrainScene scene;
  // Heights 0 and 1 below, 2 and 7 above; middles at 0.25 and 0.75 m.
  scene.Set({0, 0}, test::FreeCell(0));
  scene.Set({1, 0}, test::FreeCell(1));
  scene.Set({0, 1}, test::FreeCell(2));
  CellBelief unsure = test::FreeCell(7);
  unsure.variance_m2 = 0.05f;
  scene.Set({1, 1}, unsure);
  EXPECT_FLOAT_EQ(At(scene, 0.25, 0.25).elevation_m, 0);
  EXPECT_FLOAT_EQ(At(scene, 0.5, 0.25).elevation_m, 0.5f);
  EXPECT_FLOAT_EQ(At(scene, 0.5, 0.5).elevation_m, 2.5f);
  // A quarter of the way right, three quarters up: weights 3/16, 1/16, 9/16, 3/16.
  EXPECT_FLOAT_EQ(At(scene, 0.375, 0.625).elevation_m, (0 + 1 + 18 + 21) / 16.0f);
  EXPECT_FLOAT_EQ(At(scene, 0.375, 0.625).variance_m2, (0.13f + 0.15f) / 16.0f);
}

TEST(TerrainReader, BesideAnUnknownCellTheHeightIsTheCellsOwn) {
  TerrainScene scene;
  scene.Set({0, 0}, test::FreeCell(1));
  scene.Set({1, 0}, test::FreeCell(3));
  scene.Set({0, 1}, test::FreeCell(3));
  // The fourth cell around this place is unknown.
  EXPECT_FLOAT_EQ(At(scene, 0.4, 0.4).elevation_m, 1);
  // Known neighbours do not make an unknown cell known.
  EXPECT_EQ(At(scene, 0.6, 0.6), GroundSample());
}

TEST(TerrainReader, FitsTheSlopeAcrossTileBordersAtNegativeCoordinates) {
  TerrainScene scene;
  // Tiles meet at cell (-128, 0). The plane climbs 0.3 m a metre of x and 0.4 m a metre of y, so
  // half a metre a metre along its steepest line.
  scene.Fill({{-131, -3}, {-125, 3}}, [](CellIndex cell) {
    return 0.15f * static_cast<float>(cell.x) + 0.2f * static_cast<float>(cell.y);
  });
  const float want_rad = std::atan(0.5f);
  for (const std::int32_t x : {-129, -128})
    for (const std::int32_t y : {-1, 0}) {
      const GroundSample ground = TerrainReader(scene.map()).AtCell({x, y});
      ASSERT_TRUE(ground.slope_rad.has_value());
      EXPECT_NEAR(*ground.slope_rad, want_rad, 1e-5) << x << ", " << y;
    }
  // At the corner where the four tiles meet, too: -64 m is the border of tile -1.
  EXPECT_NEAR(At(scene, -64, 0).elevation_m, 0.15 * -128.5 + 0.2 * -0.5, 1e-5);
}

TEST(TerrainReader, NeedsThreeCellsThatSpanAPlaneForASlope) {
  TerrainScene scene;
  scene.Set({0, 0}, test::FreeCell(0));
  scene.Set({1, 0}, test::FreeCell(0.5f));
  EXPECT_FALSE(At(scene, 0.25, 0.25).slope_rad.has_value());
  scene.Set({-1, 0}, test::FreeCell(-0.5f));
  EXPECT_FALSE(At(scene, 0.25, 0.25).slope_rad.has_value()) << "three in a row span no plane";
  scene.Set({0, 1}, HeightOnly(0));
  ASSERT_TRUE(At(scene, 0.25, 0.25).slope_rad.has_value());
  // Half a metre up over half a metre.
  EXPECT_NEAR(*At(scene, 0.25, 0.25).slope_rad, std::numbers::pi / 4, 1e-6);
}

// Far from z = 0 single precision would spoil the fit, were heights not taken from the middle.
TEST(TerrainReader, TheSlopeDoesNotDependOnTheHeightAboveTheSea) {
  TerrainScene scene;
  scene.Fill({{-2, -2}, {2, 2}},
             [](CellIndex cell) { return 4096 + 0.125f * static_cast<float>(cell.x); });
  EXPECT_NEAR(*At(scene, 0.1, 0.1).slope_rad, std::atan(0.25), 1e-6);
}

TEST(SampleHeights, AnswersInTheOrderOfThePoints) {
  TerrainScene scene;
  scene.Set({0, 0}, test::FreeCell(1));
  scene.Set({-3, 5}, Obstacle(2));
  const auto samples =
      SampleHeights(scene.map(), {{-1.2, 2.6}, {9, 9}, {0.1, 0.1}}, [] { return false; });
  ASSERT_TRUE(samples.ok()) << samples.status();
  ASSERT_EQ(samples->size(), 3u);
  EXPECT_EQ((*samples)[0].state, GroundState::kObstacle);
  EXPECT_EQ((*samples)[0].elevation_m, 2);
  EXPECT_EQ((*samples)[1].state, GroundState::kUnknown);
  EXPECT_EQ((*samples)[2].state, GroundState::kFree);
}

TEST(SampleHeights, StopsWhenNobodyWaits) {
  int looks = 0;
  const auto samples = SampleHeights(TerrainScene().map(), std::vector<Place>(5000),
                                     [&looks] { return ++looks == 2; });
  EXPECT_TRUE(absl::IsCancelled(samples.status())) << samples.status();
  EXPECT_EQ(looks, 2);
}

TEST(SampleHeights, AnswersAtTheEdgeOfTheWorld) {
  const auto samples =
      SampleHeights(TerrainScene(0.01f).map(), {{1e6, -1e6}, {-1e6, 1e6}}, [] { return false; });
  ASSERT_TRUE(samples.ok());
  EXPECT_EQ((*samples)[0].state, GroundState::kUnknown);
}

}  // namespace
}  // namespace gem
