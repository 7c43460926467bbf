#include "client/datasets/kitti_stereo_source.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <map>

#include "core/local/local_mapper.h"
#include "tests/client/camera/textured_pair.h"
#include "tests/client/temporary_directory.h"

namespace gem {
namespace {

using ::testing::HasSubstr;

constexpr char kIdentity[] = "1 0 0 0 0 1 0 0 0 0 1 0\n";
// Focal length 100, centre (80, 30), baseline 0.4 m.
constexpr char kCalibration[] =
    "P0: 100 0 80 0 0 100 30 0 0 0 1 0\n"
    "P1: 100 0 80 -40 0 100 30 0 0 0 1 0\n";
// Camera axes in velodyne axes, and the camera 0.3 m before the velodyne.
constexpr char kTr[] = "Tr: 0 -1 0 0 0 0 -1 0 1 0 0 -0.3\n";

/// Two pairs that show a wall 2 m away: disparity 100 * 0.4 / 2 = 20.
class KittiStereoSourceTest : public ::testing::Test {
 protected:
  KittiStereoSourceTest() {
    options_.dir = dir_.path();
    WritePairs(0);
    dir_.Write("calib.txt", kCalibration);
    dir_.Write("poses.txt", std::string(kIdentity) + "1 0 0 0 0 1 0 0 0 0 1 3\n");
  }
  void WritePairs(int left_camera) {
    const TexturedPair pair = MakeTexturedPair(160, 60, 20);
    for (const std::string name : {"/000000.png", "/000001.png"}) {
      dir_.Write("image_" + std::to_string(left_camera) + name, ToPng(pair.left).value());
      dir_.Write("image_" + std::to_string(left_camera + 1) + name, ToPng(pair.right).value());
    }
  }
  std::unique_ptr<KittiStereoSource> Open() const {
    auto source = KittiStereoSource::Open(options_);
    EXPECT_TRUE(source.ok()) << source.status();
    return std::move(*source);
  }
  std::string OpenError() const {
    const auto source = KittiStereoSource::Open(options_);
    return source.ok() ? "no error" : std::string(source.status().message());
  }

  TemporaryDirectory dir_;
  KittiStereoOptions options_;
};

TEST_F(KittiStereoSourceTest, PlacesTheWallWhereItStands) {
  const auto source = Open();
  EXPECT_EQ(source->num_scans(), 2u);
  EXPECT_NEAR(source->baseline_m(), 0.4, 1e-12);
  SourceScan scan;
  ASSERT_TRUE(source->Next(scan).value());
  // 140 of 160 columns, every second pixel.
  EXPECT_GT(scan.points.size(), 0.9 * 70 * 30);
  const auto num_on_wall =
      std::count_if(scan.points.begin(), scan.points.end(),
                    [](const ScanPoint& p) { return std::abs(p.z_m - 2) < 0.03f; });
  EXPECT_GT(num_on_wall, 0.98 * static_cast<double>(scan.points.size()));
  for (const ScanPoint& point : scan.points) {
    EXPECT_EQ(point.rgba >> 24, 255u);
    EXPECT_EQ(point.rgba & 255u, point.rgba >> 8 & 255u) << "grey images give grey points";
  }
}

TEST_F(KittiStereoSourceTest, LeavesOutWhatIsTooFar) {
  options_.range_m_max = 1.9;
  SourceScan scan;
  ASSERT_TRUE(Open()->Next(scan).value());
  EXPECT_LT(scan.points.size(), 30u);
}

TEST_F(KittiStereoSourceTest, HasABaseWithXForwardAndZUp) {
  const auto source = Open();
  const Pose<Base, Sensor> T_B_S = source->T_B_S();
  const Point<Base> ahead = T_B_S * Point<Sensor>(0, 0, 1);
  const Point<Base> below = T_B_S * Point<Sensor>(0, 1, 0);
  const Point<Base> right = T_B_S * Point<Sensor>(1, 0, 0);
  EXPECT_NEAR(ahead.x(), 1, 1e-9);
  EXPECT_NEAR(below.z(), -1, 1e-9);
  EXPECT_NEAR(right.y(), -1, 1e-9);
  // The second pose is 3 m along the camera's z: 3 m along x of O.
  SourceScan scan;
  ASSERT_TRUE(source->Next(scan).value());
  EXPECT_EQ(scan.stamp_ns, 0);
  ASSERT_TRUE(source->Next(scan).value());
  EXPECT_EQ(scan.stamp_ns, 100'000'000) << "10 Hz without times.txt";
  EXPECT_NEAR(scan.T_O_B.translation().x(), 3, 1e-9);
  EXPECT_FALSE(source->Next(scan).value());
}

TEST_F(KittiStereoSourceTest, LevelsTheBaseByTheWayTheCarDrives) {
  // 6 m forward and 0.12 m up for the camera: it looks down by 0.02 rad.
  dir_.Write("poses.txt", std::string(kIdentity) + "1 0 0 0 0 1 0 -0.12 0 0 1 6\n");
  const auto source = Open();
  SourceScan scan;
  ASSERT_TRUE(source->Next(scan).value());
  ASSERT_TRUE(source->Next(scan).value());
  EXPECT_NEAR(scan.T_O_B.translation().z(), 0, 1e-9);
  EXPECT_NEAR(scan.T_O_B.translation().x(), std::hypot(6, 0.12), 1e-9);
  const Point<Base> on_axis = source->T_B_S() * Point<Sensor>(0, 0, 10);
  EXPECT_NEAR(on_axis.z(), -0.2, 1e-3);
}

TEST_F(KittiStereoSourceTest, HasTheVelodyneAsBaseWhereTheCalibrationKnowsIt) {
  dir_.Write("calib.txt", std::string(kCalibration) + kTr);
  const auto source = Open();
  EXPECT_NEAR(source->T_B_S().translation().x(), 0.3, 1e-9);
  SourceScan scan;
  ASSERT_TRUE(source->Next(scan).value());
  ASSERT_TRUE(source->Next(scan).value());
  EXPECT_NEAR(scan.T_O_B.translation().x(), 3, 1e-9);
}

TEST_F(KittiStereoSourceTest, PrefersTheColourCameras) {
  WritePairs(2);
  // Camera 2 is 0.06 m to the left of camera 0, camera 3 0.34 m to the right.
  dir_.Write("calib.txt", std::string(kCalibration) +
                              "P2: 100 0 80 6 0 100 30 0 0 0 1 0\n"
                              "P3: 100 0 80 -34 0 100 30 0 0 0 1 0\n");
  const auto source = Open();
  EXPECT_NEAR(source->baseline_m(), 0.4, 1e-9);
  EXPECT_NEAR(source->T_B_S().translation().y(), 0.06, 1e-9);
}

TEST_F(KittiStereoSourceTest, GivesCorrectedPosesBesideOdometry) {
  dir_.Write("better.txt", std::string(kIdentity) + "1 0 0 0 0 1 0 0 0 0 1 4\n");
  options_.corrected = "better.txt";
  const auto source = Open();
  SourceScan scan;
  ASSERT_TRUE(source->Next(scan).value());
  ASSERT_TRUE(source->Next(scan).value());
  EXPECT_NEAR(scan.T_G_B.value().translation().x(), 4, 1e-9);
}

TEST_F(KittiStereoSourceTest, ErrsAsAStereoCameraDoes) {
  const NoiseModel noise = Open()->noise();
  EXPECT_FALSE(noise.along_beam);
  // sigma_z = z^2 * 0.5 / (100 * 0.4): 5 cm at 2 m.
  EXPECT_NEAR(noise.axial_m[2] * 4, 0.05, 1e-6);
  EXPECT_EQ(noise.axial_m[0], 0);
  // Half a pixel.
  EXPECT_NEAR(noise.lateral_m[1], 0.005, 1e-6);
}

TEST_F(KittiStereoSourceTest, SaysWhatIsMissing) {
  std::filesystem::remove(dir_.File("image_1/000001.png"));
  EXPECT_THAT(OpenError(), HasSubstr("image_1/000001.png: no such file, the other half of"));
  dir_.Write("poses.txt", kIdentity);
  WritePairs(0);
  EXPECT_THAT(OpenError(), HasSubstr("poses.txt has 1 poses, but there are 2 pairs"));
  dir_.Write("times.txt", "1\n");
  EXPECT_THAT(OpenError(), HasSubstr("times.txt has 1 times, but there are 2 pairs"));
  dir_.Write("calib.txt", "P0: 100 0 80 0 0 100 30 0 0 0 1 0\n");
  EXPECT_THAT(OpenError(), HasSubstr("calib.txt: no line \"P1:\""));
  options_.dir = dir_.File("nowhere");
  EXPECT_THAT(OpenError(), HasSubstr("nowhere/image_0: No such file or directory"));
}

TEST_F(KittiStereoSourceTest, RefusesCamerasThatAreNoPair) {
  dir_.Write("calib.txt",
             "P0: 100 0 80 0 0 100 30 0 0 0 1 0\nP1: 100 0 81 -40 0 100 30 0 0 0 1 0\n");
  EXPECT_THAT(OpenError(), HasSubstr("P0 and P1 differ in focal length or centre"));
  dir_.Write("calib.txt",
             "P0: 100 0 80 0 0 100 30 0 0 0 1 0\nP1: 100 0 80 40 0 100 30 0 0 0 1 0\n");
  EXPECT_THAT(OpenError(), HasSubstr("want a positive baseline"));
}

TEST_F(KittiStereoSourceTest, NamesTheOptionItDoesNotTake) {
  options_.pixel_step = 0;
  EXPECT_THAT(OpenError(), HasSubstr("stereo.pixel_step is 0"));
  options_.pixel_step = 1;
  options_.range_m_max = -1;
  EXPECT_THAT(OpenError(), HasSubstr("stereo.range_m_max is -1"));
}

TEST_F(KittiStereoSourceTest, NamesTheImageItCannotRead) {
  dir_.Write("image_1/000000.png", "not a picture");
  SourceScan scan;
  EXPECT_THAT(std::string(Open()->Next(scan).status().message()),
              HasSubstr("image_1/000000.png: not a readable PNG"));
}

/// Height of the road under the car's path at (x, y) of O, if the car drove within 1 m of it.
std::optional<double> RoadUnderTheCar_m(const std::vector<Pose<Odom, Base>>& path, double x_m,
                                        double y_m) {
  constexpr double kCameraHeight_m = 1.65;  // KITTI's figure
  for (std::size_t i = 1; i < path.size(); ++i) {
    const Eigen::Vector3d& a = path[i - 1].translation();
    const Eigen::Vector3d step = path[i].translation() - a;
    const double length2 = step.head<2>().squaredNorm();
    const double along = ((x_m - a.x()) * step.x() + (y_m - a.y()) * step.y()) / length2;
    const double beside_m =
        std::abs((x_m - a.x()) * step.y() - (y_m - a.y()) * step.x()) / std::sqrt(length2);
    if (along < 0 || along > 1 || beside_m > 1) continue;
    return a.z() + along * step.z() - kCameraHeight_m * path[i].matrix()(2, 2);
  }
  return std::nullopt;
}

double MedianOf(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + values.size() / 2, values.end());
  return values[values.size() / 2];
}

// KITTI 06, frames 0 to 23: what the local mapper makes of them against the road that the car
// stands on, by its poses and the height of its camera.
TEST(KittiStereoRealData, MapsTheRoadUnderTheCar) {
  const char* data = std::getenv("GEM_DATA_DIR");
  if (data == nullptr) GTEST_SKIP() << "SKIPPED: set GEM_DATA_DIR to the unpacked KITTI data";
  KittiStereoOptions options;
  options.dir = std::string(data) + "/sequences/06";
  auto source = KittiStereoSource::Open(options);
  ASSERT_TRUE(source.ok()) << source.status();
  LocalMapOptions map;
  map.side_m = 40;
  map.range_m_max = 20;
  const auto mapper = MakeLocalMapper(LocalBackend::kCpu, map).value();
  SourceScan from;
  Scan scan;
  scan.T_B_S = (*source)->T_B_S();
  scan.noise = (*source)->noise();
  std::vector<EvictedCell> cells;
  std::vector<Pose<Odom, Base>> path;
  while ((*source)->Next(from).value()) {
    ++scan.seq;
    scan.stamp_ns = from.stamp_ns;
    scan.T_O_B = from.T_O_B;
    scan.points = from.points;
    EXPECT_GT(from.points.size(), 30'000u);
    mapper->FuseScan(scan, cells);
    path.push_back(from.T_O_B);
  }
  ASSERT_EQ(path.size(), 24u);
  cells.clear();
  mapper->EvictAll(cells);

  const Eigen::Vector3d car = path.back().translation();
  std::vector<double> error_m, magnitude_m;
  for (const EvictedCell& evicted : cells) {
    const double x_m = CenterOf(evicted.cell.x, map.cell_size_m);
    const double y_m = CenterOf(evicted.cell.y, map.cell_size_m);
    if (std::hypot(x_m - car.x(), y_m - car.y()) > 10) continue;
    const std::optional<double> road_m = RoadUnderTheCar_m(path, x_m, y_m);
    if (!road_m) continue;
    error_m.push_back(evicted.belief.elevation_m - *road_m);
    magnitude_m.push_back(std::abs(error_m.back()));
  }
  // The car drove over 10 m x 2 m of what is near it: 500 cells.
  ASSERT_GT(error_m.size(), 450u);
  std::printf(
      "stereo map against the road under the car, within 10 m: %zu cells, median %.1f cm, "
      "median magnitude %.1f cm\n",
      error_m.size(), 100 * MedianOf(error_m), 100 * MedianOf(magnitude_m));
  EXPECT_LT(MedianOf(magnitude_m), 0.05);
}

}  // namespace
}  // namespace gem
