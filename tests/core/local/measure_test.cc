#include "core/local/measure.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "tests/core/local/scenes.h"

namespace gem {
namespace {

constexpr double kHalfPi = std::numbers::pi / 2;

// A robot at (100, 50, 10) that looks along +y of O, its sensor 0.5 m ahead and 1 m up.
Scan TurnedScan() {
  Scan scan;
  scan.T_O_B = Pose<Odom, Base>::FromYaw(kHalfPi, {100, 50, 10});
  scan.T_B_S = Pose<Base, Sensor>::FromTranslation(0.5, 0, 1);
  scan.noise = testing::LidarNoiseModel();
  return scan;
}

ScanFrame FrameOf(const Scan& scan, const LocalMapOptions& options) {
  const Eigen::Vector3d& base = scan.T_O_B.translation();
  const CellIndex cell = CellAt(base.x(), base.y(), options.cell_size_m);
  const std::int32_t half = SideCells(options) / 2;
  return MakeScanFrame(scan, {cell.x - half, cell.y - half}, options);
}

PointFate FateOf(const ScanPoint& p_S, const LocalMapOptions& options) {
  return MeasureBeam(FrameOf(TurnedScan(), options), p_S).fate;
}

TEST(Measure, FindsElevationAndCellOfATurnedScan) {
  LocalMapOptions options;
  options.cell_size_m = 0.5f;  // 16 cells, lower left cell (192, 92) at (96, 46)
  const ScanFrame frame = FrameOf(TurnedScan(), options);
  // 2.1 m ahead is +y, 0.3 m to the left is -x: O (99.7, 52.6, 10.25).
  const Beam beam = MeasureBeam(frame, {2.1f, 0.3f, -0.75f, 0});
  ASSERT_EQ(beam.fate, PointFate::kInWindow);
  EXPECT_EQ(beam.column, 7);  // 3.7 m
  EXPECT_EQ(beam.row, 13);    // 6.6 m
  EXPECT_FLOAT_EQ(ElevationOf(frame, beam), 10.25f);
  EXPECT_FLOAT_EQ(beam.range_m, std::sqrt(2.1f * 2.1f + 0.3f * 0.3f + 0.75f * 0.75f));
}

TEST(Measure, TellsTheFatesApart) {
  LocalMapOptions options;
  options.range_m_max = 50;
  options.body = {-1, -1, 0, 1, 1, 2};
  EXPECT_EQ(FateOf({0.1f, 0, 0, 0}, options), PointFate::kOutOfRange);  // nearer than 0.5 m
  EXPECT_EQ(FateOf({51, 0, 0, 0}, options), PointFate::kOutOfRange);
  EXPECT_EQ(FateOf({3e38f, 0, 0, 0}, options), PointFate::kOutOfRange);  // its square overflows
  EXPECT_EQ(FateOf({-0.6f, 0, 0, 0}, options), PointFate::kOnBody);      // B (-0.1, 0, 1)
  EXPECT_EQ(FateOf({0, 0, -11.1f, 0}, options), PointFate::kTooLow);     // 10.1 m under the base
  EXPECT_EQ(FateOf({2, 0, 2.1f, 0}, options), PointFate::kTooHigh);      // 3.1 m over the base
  EXPECT_EQ(FateOf({9, 0, 0, 0}, options), PointFate::kOutsideWindow);
  EXPECT_EQ(FateOf({2, 0, 0, 0}, options), PointFate::kInWindow);
}

TEST(Measure, AnEmptyBodyBoxTakesNoPoint) {
  LocalMapOptions options;
  options.range_m_min = 0;
  EXPECT_EQ(FateOf({-0.5f, 0, -1, 0}, options), PointFate::kInWindow);  // the very origin of B
}

TEST(Measure, RaysCountUnlessTheirEndIsNotBelieved) {
  EXPECT_TRUE(RayCounts(PointFate::kInWindow));
  EXPECT_TRUE(RayCounts(PointFate::kOutsideWindow));
  EXPECT_TRUE(RayCounts(PointFate::kTooHigh));
  EXPECT_FALSE(RayCounts(PointFate::kTooLow));
  EXPECT_FALSE(RayCounts(PointFate::kOnBody));
  EXPECT_FALSE(RayCounts(PointFate::kOutOfRange));
}

TEST(Measure, APointOnABorderBelongsToTheUpperCell) {
  LocalMapOptions options;
  options.cell_size_m = 0.25f;  // borders that floats hold exactly
  options.range_m_min = 0;
  const ScanFrame frame = FrameOf(Scan(), options);  // the window's corner is at -4 m
  for (int cell = -16; cell < 16; ++cell) {
    const float border_m = static_cast<float>(cell) * 0.25f;
    const Beam beam = MeasureBeam(frame, {border_m, border_m, 0, 0});
    EXPECT_EQ(beam.column, cell + 16) << border_m;
    EXPECT_EQ(beam.row, cell + 16) << border_m;
  }
  EXPECT_EQ(MeasureBeam(frame, {4, 0, 0, 0}).fate, PointFate::kOutsideWindow);
  EXPECT_EQ(MeasureBeam(frame, {0, -4.0001f, 0, 0}).fate, PointFate::kOutsideWindow);
}

TEST(Measure, FarOutCoordinatesKeepTheirPrecision) {
  LocalMapOptions options;
  Scan near = TurnedScan();
  Scan far = near;
  // 4,194,304 cells of 0.25 m: every number stays exact in doubles, none would in floats.
  options.cell_size_m = 0.25f;
  far.T_O_B = {near.T_O_B.rotation(),
               near.T_O_B.translation() + Eigen::Vector3d(1048576, -1048576, 0)};
  for (float x_m = 0.6f; x_m < 4; x_m += 0.013f) {
    const ScanPoint p_S{x_m, 0.37f * x_m, 0, 0};
    const Beam a = MeasureBeam(FrameOf(near, options), p_S);
    const Beam b = MeasureBeam(FrameOf(far, options), p_S);
    EXPECT_EQ(a.fate, b.fate);
    EXPECT_EQ(a.column, b.column);
    EXPECT_EQ(a.row, b.row);
  }
}

// Eq. (4) whole, at the point itself.
float VarianceOf(const ScanFrame& frame, const ScanPoint& p_S, const Beam& beam) {
  return SensorVarianceOf(frame, p_S, beam) +
         PoseVarianceAt(frame, frame.sensor_x_m + beam.x_m, frame.sensor_y_m + beam.y_m);
}

TEST(Variance, OfAHorizontalBeamIsTheLateralOne) {
  const ScanFrame frame = FrameOf(TurnedScan(), LocalMapOptions());
  const ScanPoint p_S{3, 0, 0, 0};
  // sigma_lateral = 0.0015 + 0.0006 * 3 = 0.0033 m.
  EXPECT_NEAR(VarianceOf(frame, p_S, MeasureBeam(frame, p_S)), 0.0033 * 0.0033, 1e-9);
}

TEST(Variance, OfAVerticalBeamIsTheAxialOne) {
  const ScanFrame frame = FrameOf(TurnedScan(), LocalMapOptions());
  const ScanPoint p_S{0, 0, -1, 0};
  EXPECT_NEAR(VarianceOf(frame, p_S, MeasureBeam(frame, p_S)), 0.018 * 0.018, 1e-9);
}

TEST(Variance, OfAPitchErrorGrowsWithTheDistanceFromTheBaseNotFromTheSensor) {
  Scan scan = TurnedScan();
  scan.rotation_covariance_rad2.diagonal() << 0, 1e-4, 0;  // pitch, sigma 0.01 rad, in B
  const ScanFrame frame = FrameOf(scan, LocalMapOptions());
  const ScanPoint p_S{3, 1, -1, 0};
  const Beam beam = MeasureBeam(frame, p_S);
  // The lever arm along B's x is 3 + 0.5 m, though the robot looks along y of O.
  const double rotation_m2 = 3.5 * 3.5 * 1e-4;
  const float sensor_m2 = VarianceAlong(scan.noise, 0, 0, 1, 3, 1, -1, beam.range_m);
  EXPECT_NEAR(VarianceOf(frame, p_S, beam), sensor_m2 + rotation_m2, 1e-8);
}

TEST(Variance, OfThePoseIsTakenInTheMiddleOfACell) {
  Scan scan = TurnedScan();
  scan.rotation_covariance_rad2.diagonal() << 1e-4, 2e-4, 0;
  const ScanFrame frame = FrameOf(scan, LocalMapOptions());
  EXPECT_EQ(PoseVarianceOfCell(frame, 7, 3),
            PoseVarianceAt(frame, 7.5f * frame.cell_size_m, 3.5f * frame.cell_size_m));
}

// The derivative of eq. (3), taken numerically on a tilted robot with a tilted sensor.
TEST(Variance, OfARotationErrorIsWhatPerturbingThePoseDoes) {
  Scan scan;
  scan.T_O_B = {Eigen::Quaterniond(Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, -2, 3).normalized())),
                {5, -3, 2}};
  scan.T_B_S = {Eigen::Quaterniond(Eigen::AngleAxisd(-0.4, Eigen::Vector3d(2, 1, 1).normalized())),
                {0.3, -0.8, 1.2}};
  Eigen::Matrix3d root;
  root << 0.01, 0.002, 0, 0, 0.02, -0.003, 0.004, 0, 0.015;
  scan.rotation_covariance_rad2 = root * root.transpose();
  LocalMapOptions options;
  options.height_m_max = 100;
  const Point<Sensor> p_S(2.5, -1.5, 0.5);
  const Point<Base> p_B = scan.T_B_S * p_S;
  Eigen::RowVector3d J_phi;
  constexpr double kStep_rad = 1e-6;
  for (int axis = 0; axis < 3; ++axis) {
    const auto elevation_at = [&](double angle_rad) {
      const Eigen::Quaterniond turn(Eigen::AngleAxisd(angle_rad, Eigen::Vector3d::Unit(axis)));
      return (scan.T_O_B.rotation() * turn * p_B.xyz()).z();
    };
    J_phi(axis) = (elevation_at(kStep_rad) - elevation_at(-kStep_rad)) / (2 * kStep_rad);
  }
  const double expected_m2 = J_phi * scan.rotation_covariance_rad2 * J_phi.transpose();
  scan.noise = NoiseModel();  // a perfect sensor: what is left is the rotation
  const ScanFrame frame = FrameOf(scan, options);
  const ScanPoint point{2.5f, -1.5f, 0.5f, 0};
  EXPECT_NEAR(VarianceOf(frame, point, MeasureBeam(frame, point)), expected_m2,
              1e-6 * expected_m2 + 1e-9);
}

}  // namespace
}  // namespace gem
