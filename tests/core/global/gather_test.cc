#include "core/global/gather.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <set>

#include "core/global/coverage.h"
#include "core/global/placement.h"
#include "scenes.h"

namespace gem {
namespace {

using test::Flat;
using test::MakeSubmap;

constexpr double kCell_m = 0.2f;

Gather Through(const Submap& submap, const Pose<Global, Submap>& T_G_K) {
  return {T_G_K.matrix(), T_G_K.translation(), submap.origin().cell_size_m,
          submap.elevation_m_min(), submap.elevation_m_max()};
}

Pose<Global, Submap> Tilted(double yaw_rad, double pitch_rad, double roll_rad,
                            const Eigen::Vector3d& t) {
  const Eigen::Quaterniond yaw(Eigen::AngleAxisd(yaw_rad, Eigen::Vector3d::UnitZ()));
  const Eigen::Quaterniond pitch(Eigen::AngleAxisd(pitch_rad, Eigen::Vector3d::UnitY()));
  const Eigen::Quaterniond roll(Eigen::AngleAxisd(roll_rad, Eigen::Vector3d::UnitX()));
  const Eigen::Quaterniond yaw_pitch = yaw * pitch;
  return {yaw_pitch * roll, t};
}

float Rough(CellIndex c) { return 0.1f * static_cast<float>((c.x * 31 + c.y * 17) % 7); }
/// A wall of 2 m across the submap and a ditch of 1 m beside it.
float Steps(CellIndex c) { return c.x == 5 ? 2.0f : c.x == 8 ? -1.0f : 0.0f; }

TEST(Gather, AWholeCellTranslationIsOneToOneAndExact) {
  const auto submap = MakeSubmap("s", 1, {}, {{-30, -20}, {40, 25}}, Rough);
  for (const std::int32_t shift : {0, 1, -7, 4'000'000}) {
    const auto T_G_K =
        Pose<Global, Submap>::FromTranslation(shift * kCell_m, -shift * kCell_m, 2.5);
    const Gather gather = Through(*submap, T_G_K);
    for (CellIndex c{-40, -40}; c.y < 50; ++c.y) {
      for (c.x = -40; c.x < 50; ++c.x) {
        const auto hit = gather.At(*submap, {c.x + shift, c.y - shift});
        ASSERT_EQ(hit.has_value(), submap->rect().Contains(c));
        if (!hit) continue;
        ASSERT_EQ(hit->position, *submap->Find(c));
        ASSERT_EQ(hit->elevation_m, static_cast<float>(Rough(c) + 2.5));
      }
    }
  }
}

/// Cells of G whose centre lies safely inside of the submap's outline at every height it has.
bool SafelyInside(const Pose<Global, Submap>& T_G_K, const Submap& submap, CellIndex cell_G) {
  const Eigen::Matrix3d R = T_G_K.matrix();
  const Eigen::Vector3d down_K = R.transpose() * Eigen::Vector3d::UnitZ();
  const Eigen::Vector3d foot = R.transpose() * (Eigen::Vector3d(CenterOf(cell_G.x, kCell_m),
                                                                CenterOf(cell_G.y, kCell_m), 0) -
                                                T_G_K.translation());
  for (const double z : {submap.elevation_m_min(), submap.elevation_m_max()}) {
    const Eigen::Vector3d p = foot + down_K * ((z - foot.z()) / down_K.z());
    const CellRect& rect = submap.rect();
    if (!(p.x() > rect.min.x * kCell_m + 1e-6 && p.x() < rect.max.x * kCell_m - 1e-6 &&
          p.y() > rect.min.y * kCell_m + 1e-6 && p.y() < rect.max.y * kCell_m - 1e-6))
      return false;
  }
  return true;
}

int CountHoles(const Submap& submap, const Pose<Global, Submap>& T_G_K, int& inside) {
  const Gather gather = Through(submap, T_G_K);
  int holes = 0;
  for (CellIndex c{-70, -70}; c.y < 70; ++c.y) {
    for (c.x = -70; c.x < 70; ++c.x) {
      if (!SafelyInside(T_G_K, submap, c)) continue;
      ++inside;
      if (!gather.At(submap, c)) ++holes;
    }
  }
  return holes;
}

TEST(Gather, AFlatSubmapTurnedByAnyAngleHasNoHoles) {
  const auto submap = MakeSubmap("s", 1, {}, {{-40, -40}, {40, 40}}, Flat(1));
  for (int degrees = 0; degrees <= 90; ++degrees) {
    int inside = 0;
    EXPECT_EQ(CountHoles(*submap, Tilted(degrees * M_PI / 180, 0, 0, {0.07, -0.03, 0}), inside), 0)
        << degrees;
    EXPECT_GT(inside, 6000);
  }
}

TEST(Gather, ATiltedSubmapHasNoHolesWhateverItsShape) {
  for (const test::HeightOf& shape : {Flat(-3), test::HeightOf(Rough), test::HeightOf(Steps)}) {
    const auto submap = MakeSubmap("s", 1, {}, {{-40, -40}, {40, 40}}, shape);
    for (int yaw = 0; yaw <= 90; yaw += 15) {
      for (const int tilt : {-20, -7, 1, 13, 20}) {
        int inside = 0;
        const double rad = M_PI / 180;
        EXPECT_EQ(CountHoles(*submap, Tilted(yaw * rad, tilt * rad, -tilt * 0.7 * rad, {0, 0, 0}),
                             inside),
                  0)
            << yaw << " " << tilt;
        EXPECT_GT(inside, 3000);
      }
    }
  }
}

TEST(Gather, ATiltedPlaneStaysAPlane) {
  // Flat at 1 m in K, pitched by 0.1 rad: z = cos(0.1) - x_K sin(0.1), x = x_K cos(0.1) + sin(0.1).
  const auto submap = MakeSubmap("s", 1, {}, {{-40, -40}, {40, 40}}, Flat(1));
  const Gather gather = Through(*submap, Tilted(0, 0.1, 0, {0, 0, 0}));
  for (const std::int32_t x : {-30, -3, 0, 12, 30}) {
    const auto hit = gather.At(*submap, {x, 3});
    ASSERT_TRUE(hit.has_value());
    const double x_K = (CenterOf(x, kCell_m) - std::sin(0.1)) / std::cos(0.1);
    EXPECT_NEAR(hit->elevation_m, std::cos(0.1) - x_K * std::sin(0.1), 1e-6);
  }
}

TEST(Gather, AtAStepTheHigherCellCounts) {
  // The ground rises by 2 m at x = 0 of K. K leans so that lines run into the side of the step.
  const auto submap = MakeSubmap("s", 1, {}, {{-40, -40}, {40, 40}},
                                 [](CellIndex c) { return c.x >= 0 ? 2.0f : 0.0f; });
  const Pose<Global, Submap> T_G_K = Tilted(0, 0.3, 0, {0, 0, 0});
  const Gather gather = Through(*submap, T_G_K);
  int sides = 0;
  for (std::int32_t x = -30; x < 30; ++x) {
    const auto hit = gather.At(*submap, {x, 0});
    ASSERT_TRUE(hit.has_value());
    // Every line that meets neither top face goes through the side: sin(0.3) * 2 m = 0.59 m wide.
    const float e = submap->elevation_m(hit->position);
    const Eigen::Vector3d p_K =
        T_G_K.Inverse().matrix() * Eigen::Vector3d(CenterOf(x, kCell_m), 0.1, hit->elevation_m);
    const bool on_top = (e == 2.0f) == (p_K.x() >= 0);
    if (!on_top) {
      ++sides;
      EXPECT_EQ(e, 2.0f);
    }
  }
  EXPECT_GE(sides, 2);
  EXPECT_LE(sides, 4);
}

TEST(Gather, UnknownCellsStayUnknownBehindAWall) {
  // Only the wall is known: nothing is known of what lies beside it, whatever the tilt.
  std::vector<KeyedSubmapCell> wall;
  for (std::int32_t y = -40; y < 40; ++y) wall.push_back({{0, y}, test::Cell(2, 1)});
  wall.push_back({{30, 0}, test::Cell(-5, 1)});  // a pit far away makes the lines long
  SubmapOrigin origin;
  origin.cell_size_m = 0.2f;
  const Submap submap(origin, wall);
  const Gather gather = Through(submap, Tilted(0, 0.3, 0, {0, 0, 0}));
  int hits = 0;
  for (std::int32_t x = -30; x < 25; ++x) hits += gather.At(submap, {x, 0}) ? 1 : 0;
  EXPECT_GE(hits, 1);
  EXPECT_LE(hits, 2) << "as wide as one cell, not as the shadow of the wall";
}

TEST(Gather, WhatStandsOnItsHeadIsNoHeightField) {
  const auto submap = MakeSubmap("s", 1, {}, {{0, 0}, {4, 4}}, Flat(0));
  EXPECT_FALSE(Through(*submap, Tilted(0, M_PI, 0, {0, 0, 0})).upright());
  EXPECT_FALSE(Through(*submap, Tilted(0, M_PI / 2, 0, {0, 0, 0})).upright());
  EXPECT_TRUE(Through(*submap, Tilted(2, 0.5, 0.5, {0, 0, 0})).upright());
  EXPECT_TRUE(Place(SubmapId{1}, submap, true, Tilted(0, M_PI, 0, {0, 0, 0})).tiles.empty());
}

TEST(Placement, ItsTilesHoldEveryCellThatItShows) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> angle(-0.4, 0.4), metres(-60, 60);
  const auto submap = MakeSubmap("s", 1, {}, {{-40, -10}, {60, 30}}, Steps);
  for (int i = 0; i < 40; ++i) {
    const Pose<Global, Submap> T_G_K = Tilted(8 * angle(random), angle(random), angle(random),
                                              {metres(random), metres(random), metres(random)});
    const PlacedSubmap placed = Place(SubmapId{1}, submap, true, T_G_K);
    const std::set<TileIndex> tiles(placed.tiles.begin(), placed.tiles.end());
    const Gather gather = Through(*submap, T_G_K);
    int shown = 0;
    for (CellIndex c{-600, -600}; c.y < 600; ++c.y) {
      for (c.x = -600; c.x < 600; ++c.x) {
        if (!gather.At(*submap, c)) continue;
        ++shown;
        ASSERT_TRUE(tiles.contains(TileOf(c)));
        ASSERT_TRUE(placed.rect_G.Contains(c));
      }
    }
    EXPECT_GT(shown, 3000);
  }
}

TEST(Placement, AlignedCellsTouchTheirOwnTileOnly) {
  const auto submap = MakeSubmap("s", 1, {}, {{0, 0}, {128, 128}}, Flat(0));
  EXPECT_EQ(Place(SubmapId{1}, submap, true, {}).tiles, (std::vector<TileIndex>{{0, 0}}));
  const auto one_left = Pose<Global, Submap>::FromTranslation(-kCell_m, 0, 0);
  EXPECT_EQ(Place(SubmapId{1}, submap, true, one_left).tiles,
            (std::vector<TileIndex>{{-1, 0}, {0, 0}}));
}

TEST(Placement, AMillionMetresAwayItStillTouchesFewTiles) {
  const auto submap = MakeSubmap("s", 1, {}, {{0, 0}, {100, 100}}, Flat(0));
  const PlacedSubmap placed = Place(SubmapId{1}, submap, true, Tilted(1, 0.1, 0, {1e6, -1e6, 0}));
  EXPECT_GE(placed.tiles.size(), 1u);
  EXPECT_LE(placed.tiles.size(), 9u);
  const PlacedSubmap beyond = Place(SubmapId{1}, submap, true, Tilted(1, 0.1, 0, {1e12, 0, 0}));
  EXPECT_TRUE(beyond.tiles.empty());
}

}  // namespace
}  // namespace gem
