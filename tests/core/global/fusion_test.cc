#include "core/global/fusion.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <random>

#include "scenes.h"

namespace gem {
namespace {

TEST(Agree, IsTrueUpToTheGateAndNotBeyond) {
  // Standard deviation of the difference: sqrt(0.09 + 0.16) = 0.5; three of them: 1.5.
  EXPECT_TRUE(Agree(0, 0.09f, 1.49f, 0.16f, 3));
  EXPECT_FALSE(Agree(0, 0.09f, 1.51f, 0.16f, 3));
  EXPECT_TRUE(Agree(5, 0, 5, 0, 3));
}

TEST(FuseBeliefs, WeighsByInverseVariance) {
  const CellBelief a{1.0f, 0.01f, 0.8f, 0xff000000u, 5, 7};
  const CellBelief b{2.0f, 0.03f, 0.4f, 0xff0000c8u, 9, 7};
  const CellBelief fused = Fuse(a, b);
  // Weights 3/4 and 1/4.
  EXPECT_FLOAT_EQ(fused.elevation_m, 1.25f);
  EXPECT_FLOAT_EQ(fused.variance_m2, 0.0075f);
  EXPECT_FLOAT_EQ(fused.traversability, 0.7f);
  EXPECT_EQ(fused.rgba, 0xff000032u) << "200 / 4 = 50 in red";
  EXPECT_EQ(fused.stamp_ns, 9);
}

TEST(FuseBeliefs, UnknownValuesDoNotTakePart) {
  const CellBelief bare{1.0f, 0.01f, 0, 0, 5, kCellKnown};
  const CellBelief full{1.0f, 0.01f, 0.4f, 0xff0000c8u, 3, 7};
  for (const CellBelief& fused : {Fuse(bare, full), Fuse(full, bare)}) {
    EXPECT_EQ(fused.traversability, 0.4f);
    EXPECT_EQ(fused.rgba, 0xff0000c8u);
    EXPECT_EQ(fused.state, 7);
  }
}

TEST(FuseBeliefs, NeverGetsSurerThanTheFloor) {
  CellBelief cell{1.0f, 0.01f, 0, 0, 5, kCellKnown};
  const CellBelief other = cell;
  for (int i = 0; i < 100000; ++i) cell = Fuse(cell, other);
  EXPECT_FLOAT_EQ(cell.variance_m2, 1e-4f);
}

TEST(FuseSubmapCells, TheHeightGetsSurerThePlaceDoesNot) {
  const SubmapCell fused = Fuse(test::Cell(1, 1, 0.02f), test::Cell(1, 2, 0.02f));
  EXPECT_FLOAT_EQ(fused.covariance_m2[5], 0.01f);
  EXPECT_FLOAT_EQ(fused.covariance_m2[0], 0.003f);
  EXPECT_FLOAT_EQ(fused.covariance_m2[3], 0.003f);
}

TEST(FuseSubmapCells, StaysPositiveSemidefinite) {
  std::mt19937 random(3);
  std::normal_distribution<double> gauss;
  const auto cell = [&] {
    Eigen::Matrix3d root;
    for (int i = 0; i < 9; ++i) root(i / 3, i % 3) = gauss(random);
    const Eigen::Matrix3d m = root * root.transpose();
    SubmapCell c = test::Cell(0, 0);
    c.covariance_m2 = {static_cast<float>(m(0, 0)), static_cast<float>(m(0, 1)),
                       static_cast<float>(m(0, 2)), static_cast<float>(m(1, 1)),
                       static_cast<float>(m(1, 2)), static_cast<float>(m(2, 2))};
    return c;
  };
  for (int i = 0; i < 1000; ++i) {
    const Covariance3 c = Fuse(cell(), cell()).covariance_m2;
    Eigen::Matrix3d m;
    m << c[0], c[1], c[2], c[1], c[3], c[4], c[2], c[4], c[5];
    EXPECT_GT(Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(m).eigenvalues().minCoeff(), -1e-5);
  }
}

}  // namespace
}  // namespace gem
