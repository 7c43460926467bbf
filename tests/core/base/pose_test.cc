#include "core/geometry/pose.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace gem {
namespace {

TEST(Pose, MapsPointsOfTheRightFrameToTheLeft) {
  // B lies at (1, 2, 3) of O and looks along y of O.
  const auto T_O_B = Pose<Odom, Base>::FromYaw(M_PI / 2, {1, 2, 3});
  const Point<Odom> p_O = T_O_B * Point<Base>(10, 0, 0);
  EXPECT_TRUE(p_O.xyz().isApprox(Eigen::Vector3d(1, 12, 3), 1e-12));
}

TEST(Pose, AdjacentFramesCancel) {
  const auto T_G_O = Pose<Global, Odom>::FromYaw(M_PI / 2, {100, 0, 0});
  const auto T_O_B = Pose<Odom, Base>::FromTranslation(5, 1, 0);
  const Pose<Global, Base> T_G_B = T_G_O * T_O_B;
  EXPECT_TRUE(T_G_B.translation().isApprox(Eigen::Vector3d(99, 5, 0), 1e-12));
}

TEST(Pose, TheInverseUndoes) {
  const Pose<Odom, Base> T_O_B(Eigen::Quaterniond(0.8, 0.1, -0.5, 0.3).normalized(), {4, -5, 6});
  const Pose<Odom, Odom> identity = T_O_B * T_O_B.Inverse();
  EXPECT_TRUE(identity.matrix().isIdentity(1e-12));
  EXPECT_NEAR(identity.translation().norm(), 0, 1e-12);
}

TEST(Pose, AThousandProductsStayRigid) {
  std::mt19937 random(1);
  std::normal_distribution<double> gauss;
  Pose<Odom, Odom> product;
  for (int i = 0; i < 1000; ++i) {
    const Eigen::Quaterniond q(gauss(random), gauss(random), gauss(random), gauss(random));
    product = product * Pose<Odom, Odom>(q.normalized(), Eigen::Vector3d(1, 0, 0));
  }
  EXPECT_NEAR(product.rotation().norm(), 1, 1e-15);
  EXPECT_NEAR(product.matrix().determinant(), 1, 1e-12);
}

TEST(Interpolate, GoesHalfWayInTranslationAndRotation) {
  const auto a = Pose<Odom, Base>::FromYaw(0, {0, 0, 0});
  const auto b = Pose<Odom, Base>::FromYaw(1, {4, 2, 0});
  const Pose<Odom, Base> half = Interpolate(a, b, 0.5);
  EXPECT_EQ(half.translation(), Eigen::Vector3d(2, 1, 0));
  EXPECT_NEAR(Eigen::AngleAxisd(half.rotation()).angle(), 0.5, 1e-12);
}

TEST(Interpolate, TakesTheShorterWayBetweenQAndMinusQ) {
  const auto a = Pose<Odom, Base>::FromYaw(0.2, {0, 0, 0});
  const Eigen::Quaterniond other = Pose<Odom, Base>::FromYaw(0.4, {0, 0, 0}).rotation();
  const Pose<Odom, Base> b(Eigen::Quaterniond(-other.w(), -other.x(), -other.y(), -other.z()),
                           Eigen::Vector3d(0, 0, 0));
  const Eigen::Matrix3d want = Pose<Odom, Base>::FromYaw(0.3, {0, 0, 0}).matrix();
  EXPECT_TRUE(Interpolate(a, b, 0.5).matrix().isApprox(want, 1e-12));
}

TEST(Identical, IsBitForBit) {
  const auto a = Pose<Odom, Base>::FromTranslation(1, 2, 3);
  EXPECT_TRUE(Identical(a, Pose<Odom, Base>::FromTranslation(1, 2, 3)));
  EXPECT_FALSE(Identical(a, Pose<Odom, Base>::FromTranslation(1, 2, std::nextafter(3.0, 4.0))));
}

}  // namespace
}  // namespace gem
