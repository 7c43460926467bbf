#include "client/camera/project_colors.h"

#include <gtest/gtest.h>

#include <limits>
#include <vector>

namespace gem {
namespace {

constexpr Rgb kRed{200, 10, 20};
constexpr Rgb kBlue{5, 6, 250};

/// 40 x 20 pixels, red on the left and blue on the right; the axis goes through pixel (20, 10).
Image Halves() {
  Image image{40, 20, {}};
  for (int v = 0; v < 20; ++v)
    for (int u = 0; u < 40; ++u) image.pixels.push_back(u < 20 ? kRed : kBlue);
  return image;
}
constexpr CameraModel kCamera{10, 10, 20, 10};

std::vector<ScanPoint> Colored(std::vector<ScanPoint> points,
                               const Pose<Camera, Sensor>& T_C_S = {}) {
  ProjectColors(points, Halves(), kCamera, T_C_S);
  return points;
}

TEST(ProjectColors, TakesThePixelThatAPointFallsOn) {
  // At 2 m, 1 m to the left: column 20 - 10 / 2 = 15. Red is in the lowest byte, alpha in the top.
  const auto points = Colored({{-1, 0, 2, 0}, {1, 0, 2, 0}});
  EXPECT_EQ(points[0].rgba, 0xff140ac8u);
  EXPECT_EQ(points[1].rgba, 0xfffa0605u);
}

TEST(ProjectColors, RoundsToTheNearestPixel) {
  // u = 19.4 and 19.6 at 1 m.
  const auto points = Colored({{-0.06f, 0, 1, 0}, {-0.04f, 0, 1, 0}});
  EXPECT_EQ(points[0].rgba, RgbaOf(kRed));
  EXPECT_EQ(points[1].rgba, RgbaOf(kBlue));
}

TEST(ProjectColors, LeavesPointsThatTheCameraDoesNotSee) {
  const std::vector<ScanPoint> unseen = {
      {0, 0, -2, 0},     // behind
      {0, 0, 0, 0},      // in the camera
      {-5, 0, 2, 0},     // column -5
      {5, 0, 2, 0},      // column 45
      {0, -3, 2, 0},     // row -5
      {0, 2.1f, 2, 0},   // row 20.5
      {1e30f, 0, 1, 0},  // no integer holds its column
  };
  std::vector<ScanPoint> points = unseen;
  EXPECT_EQ(ProjectColors(points, Halves(), kCamera, {}), 0u);
  for (const ScanPoint& point : points) EXPECT_EQ(point.rgba, 0u) << point.x_m << " " << point.y_m;
}

TEST(ProjectColors, KeepsTheColourThatAnUnseenPointHas) {
  EXPECT_EQ(Colored({{0, 0, -2, 0xff010203u}})[0].rgba, 0xff010203u);
}

TEST(ProjectColors, GivesNothingToWhatIsHiddenBehindSomethingNear) {
  // A post at 2 m hides what is at 10 m on the same pixel, and on a neighbour of it, but not the
  // wall in another block.
  const auto points = Colored({{0, 0, 10, 0}, {0.5f, 0, 10, 0}, {0, 0, 2, 0}, {9, 0, 10, 0}});
  EXPECT_EQ(points[0].rgba, 0u);
  EXPECT_EQ(points[1].rgba, 0u);
  EXPECT_EQ(points[2].rgba, RgbaOf(kBlue));
  EXPECT_EQ(points[3].rgba, RgbaOf(kBlue));
}

TEST(ProjectColors, ColoursGroundSeenAtAGrazingAngle) {
  // 1.65 m below a camera of 700 pixels focal length: 17.7 to 20 m are eight rows.
  const Image image{1200, 400, std::vector<Rgb>(1200 * 400, kRed)};
  std::vector<ScanPoint> ground;
  for (float z_m = 17.7f; z_m <= 20; z_m += 0.1f) ground.push_back({0, 1.65f, z_m, 0});
  EXPECT_EQ(ProjectColors(ground, image, {700, 700, 600, 180}, {}), ground.size());
}

TEST(ProjectColors, KnowsWhereTheCameraIsMounted) {
  // A LiDAR with x forward and z up; the camera is 1 m before it.
  Eigen::Matrix3d axes;
  axes << 0, -1, 0, 0, 0, -1, 1, 0, 0;
  const Pose<Camera, Sensor> T_C_S(Eigen::Quaterniond(axes), {0, 0, -1});
  const auto points = Colored({{3, 1, 0, 0}, {3, -1, 0, 0}, {0.5f, 0, 0, 0}}, T_C_S);
  EXPECT_EQ(points[0].rgba, RgbaOf(kRed));   // y left: on the left
  EXPECT_EQ(points[1].rgba, RgbaOf(kBlue));  // on the right
  EXPECT_EQ(points[2].rgba, 0u);             // before the LiDAR, but behind the camera
}

}  // namespace
}  // namespace gem
