#include "client/evaluation/calibration.h"

#include <gtest/gtest.h>

#include <memory>

#include "client/simulation/analytic_terrain.h"

namespace gem::evaluation {
namespace {

TEST(NormalisedErrors, AreSquaresOverTheStatedVariance) {
  NormalisedErrors errors;
  errors.Add(0.02, 1e-4);   // 4: just within two sigma
  errors.Add(-0.03, 1e-4);  // 9
  EXPECT_EQ(errors.num_cells, 2u);
  EXPECT_EQ(errors.num_within_2_sigma, 1u);
  EXPECT_NEAR(errors.mean(), 6.5, 1e-9);
}

TEST(AddErrors, ComparesKnownCellsWithTheGroundUnderTheirMiddle) {
  const World world(std::make_unique<AnalyticTerrain>(GroundPlane{.height_m = 1, .slope_x = 0.1},
                                                      std::vector<Hill>(), std::vector<Step>()));
  LocalMap map;
  map.side_cells = 2;
  map.cell_size_m = 0.2f;
  map.origin = {10, 0};
  map.ResizeLayers(4);
  // The cell at x = 2.3, y = 0.1 of O, which lies half a metre lower than G and 1 m along x.
  map.state[1] = kCellKnown;
  map.elevation_m[1] = 0.86f;
  map.variance_m2[1] = 0.01f;
  NormalisedErrors errors;
  AddErrors(map, world, Pose<Global, Odom>::FromTranslation(1, 0, 0.5), errors);
  EXPECT_EQ(errors.num_cells, 1u);
  // 1.36 m believed, 1 + 0.1 * 3.3 = 1.33 m true.
  EXPECT_NEAR(errors.mean(), 0.03 * 0.03 / 0.01, 1e-5);
}

// On a short way: the whole chain from honest noise to the variance.
TEST(Calibration, OfBothSensorsIsWithinAFactorOfThree) {
  Settings settings;
  settings.scale = 0.1;
  const auto report = RunCalibration(settings);
  ASSERT_TRUE(report.ok()) << report.status();
  int num_aimed = 0;
  for (const Figure& figure : report->figures) {
    num_aimed += figure.at_most.has_value() ? 1 : 0;
    if (!figure.at_most.has_value()) continue;
    // Twelve scans are few: the aim, with some room.
    EXPECT_GT(figure.value, 0.3) << figure.name;
    EXPECT_LT(figure.value, 3.0) << figure.name;
  }
  EXPECT_EQ(num_aimed, 4);
}

}  // namespace
}  // namespace gem::evaluation
