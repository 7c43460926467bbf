#include "client/datasets/kitti_source.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>

#include "client/formats/png_file.h"
#include "tests/client/temporary_directory.h"

namespace gem {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr char kIdentity[] = "1 0 0 0 0 1 0 0 0 0 1 0\n";
constexpr char kForward[] = "1 0 0 0 0 1 0 0 0 0 1 3\n";  // z by 3 m: forward for a camera
// Camera axes in velodyne axes: x right = -y, y down = -z, z forward = x.
constexpr char kTr[] = "P0: 1 2 3\nTr: 0 -1 0 0 0 0 -1 0 1 0 0 0\n";

std::string Bin(const std::vector<float>& values) {
  std::string bytes(values.size() * sizeof(float), '\0');
  std::memcpy(bytes.data(), values.data(), bytes.size());
  return bytes;
}

/// Two scans of one point each, in the plain layout.
class KittiSourceTest : public ::testing::Test {
 protected:
  KittiSourceTest() {
    options_.dir = dir_.path();
    dir_.Write("velodyne/000007.bin", Bin({4, 5, 6, 0.5f}));
    dir_.Write("velodyne/000003.bin", Bin({1, 2, 3, 0.5f}));
    dir_.Write("velodyne/notes.txt", "not a scan");
    dir_.Write("times.txt", "1\n2\n");
    dir_.Write("poses.txt", std::string(kIdentity) + kForward);
  }

  std::string OpenError() const {
    const auto source = KittiSource::Open(options_);
    return source.ok() ? "no error" : std::string(source.status().message());
  }

  TemporaryDirectory dir_;
  KittiOptions options_;
};

TEST_F(KittiSourceTest, GivesScansInOrderOfTheirNames) {
  const auto source = KittiSource::Open(options_);
  ASSERT_TRUE(source.ok()) << source.status();
  EXPECT_EQ((*source)->num_scans(), 2u);
  SourceScan scan;
  ASSERT_TRUE((*source)->Next(scan).value());
  EXPECT_EQ(scan.stamp_ns, 1'000'000'000);
  ASSERT_EQ(scan.points.size(), 1u);
  EXPECT_EQ(scan.points[0].x_m, 1);
  EXPECT_EQ(scan.points[0].z_m, 3);
  EXPECT_FALSE(scan.T_G_B.has_value());
  ASSERT_TRUE((*source)->Next(scan).value());
  EXPECT_EQ(scan.points[0].y_m, 5);
  EXPECT_EQ(scan.T_O_B.translation().z(), 3);
  EXPECT_FALSE((*source)->Next(scan).value());
}

TEST_F(KittiSourceTest, IsCalledByItsDirectoryWithOrWithoutSlash) {
  dir_.Write("site/velodyne/0.bin", Bin({1, 2, 3, 0}));
  dir_.Write("site/times.txt", "1\n");
  dir_.Write("site/poses.txt", kIdentity);
  options_.dir = dir_.File("site/");
  EXPECT_EQ(KittiSource::Open(options_).value()->name(), "site");
  options_.dir = dir_.File("site");
  EXPECT_EQ(KittiSource::Open(options_).value()->name(), "site");
}

TEST_F(KittiSourceTest, GivesCorrectedPosesBesideOdometry) {
  dir_.Write("better.txt", std::string(kIdentity) + "1 0 0 9 0 1 0 0 0 0 1 0\n");
  options_.corrected = "better.txt";
  const auto source = KittiSource::Open(options_);
  ASSERT_TRUE(source.ok()) << source.status();
  SourceScan scan;
  ASSERT_TRUE((*source)->Next(scan).value());
  ASSERT_TRUE((*source)->Next(scan).value());
  EXPECT_EQ(scan.T_G_B.value().translation().x(), 9);
}

TEST_F(KittiSourceTest, TurnsPosesOfTheCameraIntoPosesOfTheVelodyne) {
  dir_.Write("calib.txt", kTr);
  const auto source = KittiSource::Open(options_);
  ASSERT_TRUE(source.ok()) << source.status();
  SourceScan scan;
  ASSERT_TRUE((*source)->Next(scan).value());
  ASSERT_TRUE((*source)->Next(scan).value());
  // Three metres along the camera's z are three metres along the velodyne's x.
  EXPECT_NEAR(scan.T_O_B.translation().x(), 3, 1e-12);
  EXPECT_NEAR(scan.T_O_B.translation().z(), 0, 1e-12);
  EXPECT_NEAR(std::abs(scan.T_O_B.rotation().w()), 1, 1e-12);
}

TEST_F(KittiSourceTest, TakesPosesOfAnotherNameAsTheVelodynesOwn) {
  dir_.Write("calib.txt", kTr);
  dir_.Write("poses_odometry.txt", std::string(kIdentity) + kForward);
  options_.poses = "poses_odometry.txt";
  SourceScan scan;
  auto source = KittiSource::Open(options_).value();
  ASSERT_TRUE(source->Next(scan).value());
  ASSERT_TRUE(source->Next(scan).value());
  EXPECT_EQ(scan.T_O_B.translation().z(), 3);

  options_.pose_frame = KittiPoseFrame::kCamera;
  source = KittiSource::Open(options_).value();
  ASSERT_TRUE(source->Next(scan).value());
  ASSERT_TRUE(source->Next(scan).value());
  EXPECT_NEAR(scan.T_O_B.translation().x(), 3, 1e-12);
}

TEST_F(KittiSourceTest, NeedsTheCalibrationForPosesOfTheCamera) {
  options_.pose_frame = KittiPoseFrame::kCamera;
  EXPECT_THAT(OpenError(), HasSubstr("calib.txt: no line \"Tr:\""));
  dir_.Write("calib.txt", "P0: 1\nTr: 1 2 3\n");
  EXPECT_THAT(OpenError(), HasSubstr("calib.txt:2: Tr has 3 numbers, want 12"));
  dir_.Write("calib.txt", "Tr: 1 0 0 0 0 1 0 x 0 0 1 0\n");
  EXPECT_THAT(OpenError(), HasSubstr("calib.txt:1: Tr holds \"x\""));
}

TEST_F(KittiSourceTest, TakesTheOnlyPosesFileThereIs) {
  std::filesystem::rename(dir_.File("poses.txt"), dir_.File("poses_odometry.txt"));
  EXPECT_EQ(OpenError(), "no error");
  dir_.Write("poses_truth.txt", kIdentity);
  EXPECT_THAT(OpenError(), AllOf(HasSubstr("name one of"), HasSubstr("poses_odometry.txt"),
                                 HasSubstr("poses_truth.txt")));
}

TEST_F(KittiSourceTest, SaysWhatIsMissing) {
  options_.poses = "gone.txt";
  EXPECT_THAT(OpenError(), HasSubstr("gone.txt: no such file"));
  std::filesystem::remove(dir_.File("times.txt"));
  EXPECT_THAT(OpenError(), HasSubstr("times.txt: no such file"));
  options_.dir = dir_.File("nowhere");
  EXPECT_THAT(OpenError(), HasSubstr("nowhere/velodyne: No such file or directory"));
}

TEST_F(KittiSourceTest, NeedsAsManyTimesAsScans) {
  dir_.Write("times.txt", "1\n2\n3\n");
  EXPECT_THAT(OpenError(), AllOf(HasSubstr("times.txt has 3 times"), HasSubstr("has 2 scans")));
}

TEST_F(KittiSourceTest, NeedsAsManyPosesAsScans) {
  dir_.Write("poses.txt", kIdentity);
  EXPECT_THAT(OpenError(), HasSubstr("poses.txt has 1 poses"));
  dir_.Write("poses.txt", std::string(kIdentity) + kForward);
  dir_.Write("corrected.txt", kIdentity);
  options_.corrected = "corrected.txt";
  EXPECT_THAT(OpenError(), HasSubstr("corrected.txt has 1 poses"));
}

TEST_F(KittiSourceTest, RefusesAScanThatEndsWithinAPoint) {
  dir_.Write("velodyne/000007.bin", std::string(35, '\0'));
  const auto source = KittiSource::Open(options_);
  ASSERT_TRUE(source.ok()) << source.status();
  SourceScan scan;
  ASSERT_TRUE((*source)->Next(scan).value());
  EXPECT_THAT(std::string((*source)->Next(scan).status().message()),
              HasSubstr("velodyne/000007.bin: 35 bytes, want a multiple of 16: the file ends "
                        "within the point at offset 32"));
}

TEST_F(KittiSourceTest, DropsAndCountsPointsThatAreNotFinite) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const float inf = std::numeric_limits<float>::infinity();
  // A bad intensity does no harm: it is not used.
  dir_.Write("velodyne/000003.bin", Bin({1, nan, 3, 0, -inf, 2, 3, 0, 7, 8, 9, nan}));
  const auto source = KittiSource::Open(options_);
  ASSERT_TRUE(source.ok()) << source.status();
  SourceScan scan;
  ASSERT_TRUE((*source)->Next(scan).value());
  ASSERT_EQ(scan.points.size(), 1u);
  EXPECT_EQ(scan.points[0].x_m, 7);
  EXPECT_EQ((*source)->num_points_dropped(), 2u);
}

TEST_F(KittiSourceTest, TakesAnEmptyScan) {
  dir_.Write("velodyne/000003.bin", "");
  const auto source = KittiSource::Open(options_);
  SourceScan scan;
  ASSERT_TRUE((*source)->Next(scan).value());
  EXPECT_TRUE(scan.points.empty());
}

/// A camera that looks along the velodyne's x: red on the left, blue on the right.
class KittiColorTest : public KittiSourceTest {
 protected:
  KittiColorTest() {
    dir_.Write("calib.txt", "P2: 10 0 20 0 0 10 10 0 0 0 1 0\nTr: 0 -1 0 0 0 0 -1 0 1 0 0 0\n");
    Image image{40, 20, {}};
    for (int i = 0; i < 800; ++i)
      image.pixels.push_back(i % 40 < 20 ? Rgb{255, 0, 0} : Rgb{0, 0, 255});
    dir_.Write("image_2/000003.png", ToPng(image).value());
    // To the left, to the right, behind.
    dir_.Write("velodyne/000003.bin", Bin({4, 2, 0, 0, 4, -2, 0, 0, -4, 0, 0, 0}));
    options_.color_images = "image_2";
  }
};

TEST_F(KittiColorTest, ColoursWhatTheCameraSees) {
  const auto source = KittiSource::Open(options_);
  ASSERT_TRUE(source.ok()) << source.status();
  SourceScan scan;
  ASSERT_TRUE((*source)->Next(scan).value());
  ASSERT_EQ(scan.points.size(), 3u);
  EXPECT_EQ(scan.points[0].rgba, 0xff0000ffu);
  EXPECT_EQ(scan.points[1].rgba, 0xffff0000u);
  EXPECT_EQ(scan.points[2].rgba, 0u);
  EXPECT_EQ((*source)->num_points_colored(), 2u);
  EXPECT_EQ((*source)->num_scans_without_image(), 0u);
  // The second scan has no image: it keeps its points, without colours.
  ASSERT_TRUE((*source)->Next(scan).value());
  EXPECT_EQ(scan.points.at(0).rgba, 0u);
  EXPECT_EQ((*source)->num_scans_without_image(), 1u);
}

TEST_F(KittiColorTest, SaysWhatIsMissing) {
  options_.color_images = "photos";
  EXPECT_THAT(OpenError(), HasSubstr("photos: want a directory called image_0 to image_3"));
  options_.color_images = "image_3";
  EXPECT_THAT(OpenError(), HasSubstr("image_3: no image of any scan, such as 000003.png"));
  options_.color_images = "image_2/";
  EXPECT_EQ(OpenError(), "no error");
  dir_.Write("calib.txt", "Tr: 0 -1 0 0 0 0 -1 0 1 0 0 0\n");
  EXPECT_THAT(OpenError(), HasSubstr("calib.txt: no line \"P2:\""));
  dir_.Write("calib.txt", "P2: 10 0 20 0 0 10 10 0 0 0 1 0\n");
  EXPECT_THAT(OpenError(), HasSubstr("calib.txt: no line \"Tr:\", which colours"));
}

TEST(KittiPoseFrame, IsSpelledInOneOfThreeWays) {
  EXPECT_EQ(ParseKittiPoseFrame("auto").value(), KittiPoseFrame::kAutomatic);
  EXPECT_EQ(ParseKittiPoseFrame("velodyne").value(), KittiPoseFrame::kVelodyne);
  EXPECT_EQ(ParseKittiPoseFrame("camera").value(), KittiPoseFrame::kCamera);
  EXPECT_THAT(std::string(ParseKittiPoseFrame("imu").status().message()),
              HasSubstr("pose_frame is \"imu\""));
}

TEST(KittiRealData, OpensAndReadsTheKeyframes) {
  const char* data = std::getenv("GEM_DATA_DIR");
  if (data == nullptr) GTEST_SKIP() << "set GEM_DATA_DIR to the unpacked KITTI data";
  KittiOptions options;
  options.dir = std::string(data) + "/kitti_00_keyframes";
  options.poses = "poses_odometry.txt";
  options.corrected = "poses_corrected.txt";
  const auto source = KittiSource::Open(options);
  ASSERT_TRUE(source.ok()) << source.status();
  SourceScan scan;
  std::size_t num_scans = 0;
  while ((*source)->Next(scan).value()) {
    ++num_scans;
    EXPECT_GT(scan.points.size(), 50'000u);
    EXPECT_TRUE(scan.T_G_B.has_value());
  }
  EXPECT_EQ(num_scans, (*source)->num_scans());
  EXPECT_EQ((*source)->num_points_dropped(), 0u);
}

}  // namespace
}  // namespace gem
