#include "core/global/path_check.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>
#include <set>

#include "terrain_scenes.h"

namespace gem {
namespace {

using test::HeightOnly;
using test::Obstacle;
using test::TerrainScene;
using testing::ElementsAre;
using testing::HasSubstr;

using Cells = std::set<CellIndex>;

Cells CellsOf(const SweptFootprint& footprint, double cell_size_m) {
  Cells cells;
  footprint.ForEachRun(cell_size_m, [&](const CellRun& run) {
    for (std::int32_t x = run.first_column; x <= run.last_column; ++x)
      EXPECT_TRUE(cells.insert({x, run.row}).second) << "visited twice";
    return true;
  });
  return cells;
}

Cells Rect(std::int32_t x_first, std::int32_t y_first, std::int32_t x_last, std::int32_t y_last) {
  Cells cells;
  for (std::int32_t y = y_first; y <= y_last; ++y)
    for (std::int32_t x = x_first; x <= x_last; ++x) cells.insert({x, y});
  return cells;
}

TEST(SweptFootprint, APointCoversTheCellThatItIsIn) {
  for (const double x_m : {-1.0, -0.75, 0.0, 0.49, 0.5})
    EXPECT_EQ(CellsOf({Disc{0}, {x_m, 0.5}, {x_m, 0.5}, {}}, 0.5), (Cells{{CellOf(x_m, 0.5), 1}}))
        << x_m;
}

TEST(SweptFootprint, ADiscCoversNoCornerThatItDoesNotReach) {
  // Cells of 1 m, the middle of cell (0, 0). A radius of 0.7 reaches the sides, but not the cells
  // at the corners, whose nearest points are 0.707 m away.
  EXPECT_EQ(CellsOf({Disc{0.7}, {0.5, 0.5}, {0.5, 0.5}, {}}, 1),
            (Cells{{0, -1}, {-1, 0}, {0, 0}, {1, 0}, {0, 1}}));
  EXPECT_EQ(CellsOf({Disc{0.71}, {0.5, 0.5}, {0.5, 0.5}, {}}, 1), Rect(-1, -1, 1, 1));
}

TEST(SweptFootprint, ARectangleIsTurnedToItsHeading) {
  const Rectangle car{-0.9, -0.4, 1.9, 0.4};
  // Looking along y: 0.4 m to both sides, 1.9 m up, 0.9 m down.
  EXPECT_EQ(CellsOf({car, {0.5, 0.5}, {0.5, 0.5}, {0, 1}}, 1), Rect(0, -1, 0, 2));
  // At 45 degrees a square of 2 m reaches 1.41 m along the axes.
  const double s = std::numbers::sqrt2 / 2;
  const Cells diamond = CellsOf({Rectangle{-1, -1, 1, 1}, {0.5, 0.5}, {0.5, 0.5}, {s, s}}, 1);
  EXPECT_EQ(diamond, Rect(-1, -1, 1, 1));
  EXPECT_EQ(CellsOf({Rectangle{-1.1, -1.1, 1.1, 1.1}, {0.5, 0.5}, {0.5, 0.5}, {s, s}}, 1).size(),
            9u + 4u);
}

TEST(SweptFootprint, LeavesNothingOutOnTheWay) {
  // A point that moves along the diagonal of 45 degrees, a bit above the corners of cells.
  const double s = std::numbers::sqrt2 / 2;
  EXPECT_EQ(CellsOf({Disc{0}, {0.5, 0.6}, {2.5, 2.6}, {s, s}}, 1),
            (Cells{{0, 0}, {0, 1}, {1, 1}, {1, 2}, {2, 2}}));
  // A disc of 0.6 m that moves far along a row: its ends are round.
  Cells want = Rect(-1, 0, 10, 0);
  want.merge(Rect(0, -1, 9, -1));
  want.merge(Rect(0, 1, 9, 1));
  EXPECT_EQ(CellsOf({Disc{0.6}, {0.5, 0.5}, {9.5, 0.5}, {1, 0}}, 1), want);
}

/// Whether the closed set holds a point of the cell, by the distance of its middle line: slow and
/// obvious, for a disc that moves from a to b.
double DistanceToSquare(const Place& a, const Place& b, CellIndex cell, double cell_size_m) {
  double best = 1e9;
  for (int i = 0; i <= 4000; ++i) {
    const double t = i / 4000.0;
    const double x = a.x_m + (b.x_m - a.x_m) * t;
    const double y = a.y_m + (b.y_m - a.y_m) * t;
    const double dx = std::max({cell.x * cell_size_m - x, x - (cell.x + 1) * cell_size_m, 0.0});
    const double dy = std::max({cell.y * cell_size_m - y, y - (cell.y + 1) * cell_size_m, 0.0});
    best = std::min(best, std::hypot(dx, dy));
  }
  return best;
}

TEST(SweptFootprint, ADiscThatMovesCoversWhatItsDistanceSays) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> place(-3, 3);
  for (int trial = 0; trial < 25; ++trial) {
    const Place a{place(random), place(random)};
    const Place b{place(random), place(random)};
    const double radius_m = std::abs(place(random)) / 2;
    const double way_m = std::hypot(b.x_m - a.x_m, b.y_m - a.y_m);
    const Cells cells =
        CellsOf({Disc{radius_m}, a, b, {(b.x_m - a.x_m) / way_m, (b.y_m - a.y_m) / way_m}}, 0.3);
    for (const CellIndex cell : Rect(-18, -18, 18, 18)) {
      const double distance_m = DistanceToSquare(a, b, cell, 0.3);
      // The oracle looks at points 2 mm apart.
      if (std::abs(distance_m - radius_m) < 0.002) continue;
      EXPECT_EQ(cells.count(cell) > 0, distance_m < radius_m)
          << trial << ": " << cell.x << ", " << cell.y;
    }
  }
}

/// Separating axes: whether a turned rectangle and a cell overlap.
bool Overlap(const Rectangle& r, const Place& at, const Heading& heading, CellIndex cell,
             double cell_size_m, double slack_m) {
  const double half_m = cell_size_m / 2;
  const double dx = CenterOf(cell.x, cell_size_m) - at.x_m;
  const double dy = CenterOf(cell.y, cell_size_m) - at.y_m;
  // The cell in B.
  const double x = heading.x * dx + heading.y * dy;
  const double y = -heading.y * dx + heading.x * dy;
  const double reach = half_m * (std::abs(heading.x) + std::abs(heading.y)) + slack_m;
  if (x + reach < r.x_m_min || x - reach > r.x_m_max || y + reach < r.y_m_min ||
      y - reach > r.y_m_max)
    return false;
  // The rectangle in G.
  const double cx = (r.x_m_min + r.x_m_max) / 2, cy = (r.y_m_min + r.y_m_max) / 2;
  const double hx = (r.x_m_max - r.x_m_min) / 2, hy = (r.y_m_max - r.y_m_min) / 2;
  const double middle_x = heading.x * cx - heading.y * cy - dx;
  const double middle_y = heading.y * cx + heading.x * cy - dy;
  return std::abs(middle_x) <=
             half_m + std::abs(heading.x) * hx + std::abs(heading.y) * hy + slack_m &&
         std::abs(middle_y) <=
             half_m + std::abs(heading.y) * hx + std::abs(heading.x) * hy + slack_m;
}

TEST(SweptFootprint, ATurnedRectangleCoversWhatSeparatingAxesSay) {
  std::mt19937 random(6);
  std::uniform_real_distribution<double> number(-2, 2);
  for (int trial = 0; trial < 300; ++trial) {
    const double angle_rad = number(random) * 2;
    const Heading heading{std::cos(angle_rad), std::sin(angle_rad)};
    const Place at{number(random), number(random)};
    const double x = number(random), y = number(random);
    const Rectangle rectangle{x, y, x + std::abs(number(random)) + 0.01,
                              y + std::abs(number(random)) + 0.01};
    const double way_m = trial % 2 == 0 ? 0 : std::abs(number(random));
    const Place to{at.x_m + heading.x * way_m, at.y_m + heading.y * way_m};
    const Cells cells = CellsOf({rectangle, at, to, heading}, 0.3);
    const Rectangle swept{rectangle.x_m_min, rectangle.y_m_min, rectangle.x_m_max + way_m,
                          rectangle.y_m_max};
    for (const CellIndex cell : Rect(-32, -32, 32, 32)) {
      const bool covered = cells.count(cell) > 0;
      if (Overlap(swept, at, heading, cell, 0.3, -1e-9)) {
        EXPECT_TRUE(covered) << trial << ": " << cell.x << ", " << cell.y;
      }
      if (!Overlap(swept, at, heading, cell, 0.3, 1e-9)) {
        EXPECT_FALSE(covered) << trial << ": " << cell.x << ", " << cell.y;
      }
    }
  }
}

// Rounding at the rims must leave no row without cells: an empty one would be free.
TEST(SweptFootprint, EveryRowHasCellsWhereverItLies) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> number(-1, 1);
  for (const float cell_size : {0.01f, 0.1f, 0.2f, 0.3f, 1.0f}) {
    const double cell_size_m = static_cast<double>(cell_size);
    for (int trial = 0; trial < 2000; ++trial) {
      // On borders of cells, where it hurts, and far out.
      const double scale = trial % 2 == 0 ? 10 : 1e6;
      const Place at{std::round(number(random) * scale / cell_size_m) * cell_size_m,
                     std::round(number(random) * scale / cell_size_m) * cell_size_m};
      const double radius_m = std::round(std::abs(number(random)) * 10) * cell_size_m;
      int runs = 0;
      SweptFootprint(Disc{radius_m}, at, at, {}).ForEachRun(cell_size_m, [&](const CellRun& run) {
        EXPECT_GE(run.last_column, run.first_column);
        EXPECT_LE(run.num_cells(), 30u);
        ++runs;
        return true;
      });
      EXPECT_GE(runs, 1);
    }
  }
}

PathQuestion Ask(std::vector<Place> path, const Footprint& footprint, double step_m = 0) {
  return {std::move(path), footprint, step_m};
}

PathCheck Check(const TerrainScene& scene, const PathQuestion& question) {
  absl::StatusOr<PathCheck> check = CheckPath(scene.map(), question, [] { return false; });
  EXPECT_TRUE(check.ok()) << check.status();
  return check.ok() ? *std::move(check) : PathCheck();
}

std::vector<double> DistancesOf(const std::vector<PathStep>& steps) {
  std::vector<double> distances_m;
  for (const PathStep& step : steps) distances_m.push_back(step.distance_m);
  return distances_m;
}

TEST(WalkPath, DividesEveryPartEvenlyAndEndsAtItsCorners) {
  // 1 m and 0.5 m in steps of at most 0.4 m.
  const auto steps = WalkPath(Ask({{0, 0}, {1, 0}, {1, 0.5}}, Disc{1}, 0.4), 0.5);
  ASSERT_TRUE(steps.ok()) << steps.status();
  EXPECT_THAT(DistancesOf(*steps),
              ElementsAre(0, testing::DoubleEq(1.0 / 3), testing::DoubleEq(2.0 / 3), 1, 1.25, 1.5));
  EXPECT_EQ(steps->back().to, (Place{1, 0.5}));
  EXPECT_EQ((*steps)[3].to, (Place{1, 0}));
  EXPECT_EQ((*steps)[4].from, (Place{1, 0}));
}

TEST(WalkPath, ARectangleTurnsOnTheSpotByTheShorterWay) {
  // The farthest corner is 2 m away; a quarter turn to the left moves it by pi m.
  const Rectangle rectangle{-1, -1, std::sqrt(3), 1};
  const auto steps = WalkPath(Ask({{0, 0}, {1, 0}, {1, 1}}, rectangle, 1), 0.5);
  ASSERT_TRUE(steps.ok()) << steps.status();
  EXPECT_THAT(DistancesOf(*steps), ElementsAre(0, 1, 1, 1, 1, 1, 2));
  const Heading& quarter = (*steps)[2].heading;
  EXPECT_NEAR(std::atan2(quarter.y, quarter.x), std::numbers::pi / 8, 1e-12);
  EXPECT_EQ((*steps)[5].heading.x, 0);
  EXPECT_EQ((*steps)[5].heading.y, 1);
  EXPECT_EQ((*steps)[3].from, (*steps)[3].to);
  // Straight on there is nothing to turn.
  EXPECT_EQ(WalkPath(Ask({{0, 0}, {1, 0}, {2, 0}}, rectangle, 1), 0.5)->size(), 3u);
}

TEST(WalkPath, RepeatedCornersHaveNoHeadingAndAreLeftOut) {
  const auto steps = WalkPath(Ask({{0, 0}, {0, 0}, {0, 1}, {0, 1}}, Rectangle{-1, -1, 1, 1}, 5), 1);
  ASSERT_TRUE(steps.ok()) << steps.status();
  ASSERT_EQ(steps->size(), 2u);
  EXPECT_EQ((*steps)[0].heading.y, 1);
}

TEST(WalkPath, RefusesTooManySamplesByName) {
  const auto steps = WalkPath(Ask({{0, 0}, {6553.6, 0}}, Disc{0}, 0.1), 0.5);
  EXPECT_TRUE(absl::IsInvalidArgument(steps.status()));
  EXPECT_EQ(steps.status().message(),
            "step_m is 0.1, which makes 65537 samples of the path, want at most 65536");
  EXPECT_EQ(WalkPath(Ask({{0, 0}, {6553.5, 0}}, Disc{0}, 0.1), 0.5)->size(), 65'536u);
  EXPECT_TRUE(
      absl::IsInvalidArgument(WalkPath(Ask({{0, 0}, {1, 0}}, Disc{0}, 1e-300), 0.5).status()));
}

TEST(CheckPath, FreeGroundIsFreeToTheEnd) {
  TerrainScene scene;
  scene.FillFlat({{-4, -4}, {24, 4}});
  const PathCheck check = Check(scene, Ask({{0, 0}, {10, 0}}, Disc{0.5}));
  EXPECT_TRUE(check.free);
  EXPECT_EQ(check.free_distance_m, 10);
  ASSERT_EQ(check.samples.size(), 21u);
  EXPECT_EQ(check.samples[20].position, (Place{10, 0}));
  EXPECT_EQ(check.samples[20].worst, GroundState::kFree);
  EXPECT_EQ(check.samples[20].traversability_min, 1);
  EXPECT_EQ(check.samples[20].slope_rad_max, 0);
  EXPECT_EQ(check.samples[20].unknown_share, 0);
  EXPECT_EQ(check.worst.sample, 0u);
}

TEST(CheckPath, AnObstacleCountsIfTheFootprintTouchesItsCell) {
  TerrainScene scene;
  scene.FillFlat({{-4, -4}, {24, 4}});
  // Cell (10, 1) covers x from 5 to 5.5 m and y from 0.5 to 1 m.
  scene.Set({10, 1}, Obstacle(1));
  EXPECT_TRUE(Check(scene, Ask({{0, 0}, {10, 0}}, Disc{0.49})).free);
  const PathCheck check = Check(scene, Ask({{0, 0}, {10, 0}}, Disc{0.51}));
  EXPECT_FALSE(check.free);
  EXPECT_EQ(check.worst.position, (Place{5.25, 0.75}));
  EXPECT_EQ(check.worst.ground.state, GroundState::kObstacle);
  EXPECT_EQ(check.worst.ground.elevation_m, 1);
  // The disc touches the cell 0.1 m before its left side: on the way to the sample at 5 m.
  EXPECT_EQ(check.worst.sample, 10u);
  EXPECT_EQ(check.free_distance_m, 4.5);
  EXPECT_EQ(check.samples[9].worst, GroundState::kFree);
  EXPECT_EQ(check.samples[10].worst, GroundState::kObstacle);
  EXPECT_EQ(check.samples[10].ground.state, GroundState::kFree) << "under B it is";
}

// With a step that is longer than the robot, samples alone would step over it.
TEST(CheckPath, WhatLiesBetweenSamplesCounts) {
  TerrainScene scene;
  scene.FillFlat({{-4, -4}, {24, 4}});
  scene.Set({6, 0}, Obstacle(1));
  for (const Footprint footprint :
       {Footprint(Disc{0.2}), Footprint(Rectangle{-0.2, -0.2, 0.2, 0.2})}) {
    const PathCheck check = Check(scene, Ask({{0, 0.25}, {10, 0.25}}, footprint, 5));
    EXPECT_FALSE(check.free);
    EXPECT_EQ(check.worst.sample, 1u);
    EXPECT_EQ(check.free_distance_m, 0);
  }
}

TEST(CheckPath, ARectangleLooksAlongThePath) {
  TerrainScene scene;
  scene.FillFlat({{-30, -30}, {30, 30}});
  // A corridor along y that is 3 m wide. The robot is 4 m long and 2 m wide: it fits.
  for (std::int32_t y = -20; y < 20; ++y) {
    scene.Set({-4, y}, Obstacle(1));
    scene.Set({3, y}, Obstacle(1));
  }
  const Rectangle robot{-2, -1, 2, 1};
  EXPECT_TRUE(Check(scene, Ask({{0, -5}, {0, 5}}, robot)).free);
  // Across it does not even stand; and a turn on the spot sweeps the walls.
  EXPECT_FALSE(Check(scene, Ask({{0, 0}}, robot)).free);
  const PathCheck turn = Check(scene, Ask({{0, -3}, {0, 0}, {0.1, 0}}, robot));
  EXPECT_FALSE(turn.free);
  EXPECT_EQ(turn.free_distance_m, 3);
}

// Between the headings before and after, a corner reaches farther than with either.
TEST(CheckPath, ATurnSweepsTheCornersOfARectangle) {
  TerrainScene scene;
  scene.FillFlat({{-30, -30}, {30, 30}});
  // The corner (2, 1) is 2.24 m away and passes the middle of the quadrant on its way up.
  const Rectangle robot{-2, -1, 2, 1};
  const PathQuestion question = Ask({{-4, 0}, {0, 0}, {0, 4}}, robot);
  EXPECT_TRUE(Check(scene, question).free);
  scene.Set({3, 3}, Obstacle(1));  // x and y from 1.5 to 2 m: its nearest corner is 2.12 m away
  const PathCheck check = Check(scene, question);
  EXPECT_FALSE(check.free) << "neither heading alone covers the cell";
  EXPECT_EQ(check.free_distance_m, 4);
  EXPECT_EQ(check.samples[check.worst.sample].distance_m, 4);
}

TEST(CheckPath, APathOfOnePointLooksAlongX) {
  TerrainScene scene;
  scene.FillFlat({{0, 0}, {8, 1}});
  const PathCheck check = Check(scene, Ask({{0.25, 0.25}}, Rectangle{-0.2, -0.2, 3.7, 0.2}));
  EXPECT_TRUE(check.free);
  ASSERT_EQ(check.samples.size(), 1u);
  EXPECT_EQ(check.samples[0].distance_m, 0);
  EXPECT_EQ(check.free_distance_m, 0);
  EXPECT_FALSE(Check(scene, Ask({{0.25, 0.25}}, Rectangle{-0.2, -0.2, 3.8, 0.2})).free);
}

TEST(CheckPath, UnknownIsNeverFree) {
  TerrainScene scene;
  scene.FillFlat({{-4, -4}, {24, 4}});
  scene.Set({10, 0}, CellBelief());
  const PathCheck check = Check(scene, Ask({{0, 0.25}, {10, 0.25}}, Disc{0}));
  EXPECT_FALSE(check.free);
  EXPECT_EQ(check.worst.ground.state, GroundState::kUnknown);
  EXPECT_EQ(check.worst.position, (Place{5.25, 0.25}));
  EXPECT_EQ(check.free_distance_m, 4.5);
  // On the way from 4.5 to 5 m: cells 9 and 10.
  EXPECT_EQ(check.samples[10].unknown_share, 0.5f);
  EXPECT_EQ(check.samples[10].worst, GroundState::kUnknown);
  EXPECT_EQ(check.samples[10].traversability_min, 1) << "of the cell that has one";
  // A whole map of nothing, too.
  EXPECT_FALSE(Check(TerrainScene(), Ask({{0, 0}}, Disc{0})).free);
}

TEST(CheckPath, KnownHeightAloneIsNotFreeButBetterThanUnknownAndThatThanAnObstacle) {
  TerrainScene scene;
  scene.FillFlat({{0, 0}, {20, 1}});
  const PathQuestion question = Ask({{0.25, 0.25}, {9.75, 0.25}}, Disc{0});
  scene.Set({10, 0}, HeightOnly(2));
  PathCheck check = Check(scene, question);
  EXPECT_FALSE(check.free);
  EXPECT_EQ(check.worst.ground.state, GroundState::kHeightOnly);
  EXPECT_EQ(check.worst.ground.elevation_m, 2);
  scene.Set({12, 0}, CellBelief());
  EXPECT_EQ(Check(scene, question).worst.ground.state, GroundState::kUnknown);
  scene.Set({14, 0}, Obstacle(0, 0.5f));
  check = Check(scene, question);
  EXPECT_EQ(check.worst.ground.state, GroundState::kObstacle);
  EXPECT_EQ(check.worst.ground.traversability, 0.5f);
  // The lower traversability is the worse obstacle; of equals the first counts.
  scene.Set({16, 0}, Obstacle(0, 0.25f));
  scene.Set({18, 0}, Obstacle(0, 0.25f));
  EXPECT_EQ(Check(scene, question).worst.position, (Place{8.25, 0.25}));
}

TEST(CheckPath, TellsTheSteepestSlopeUnderTheFootprint) {
  TerrainScene scene;
  // Flat up to cell 9, then 0.25 m up a cell.
  scene.Fill({{-4, -4}, {24, 4}}, [](CellIndex cell) {
    return cell.x < 10 ? 0 : 0.25f * static_cast<float>(cell.x - 9);
  });
  const PathCheck check = Check(scene, Ask({{0, 0}, {10, 0}}, Disc{0}));
  EXPECT_EQ(check.samples[8].slope_rad_max, 0);
  EXPECT_NEAR(check.samples[20].slope_rad_max, std::atan(0.5), 1e-6);
}

TEST(CheckPath, RefusesMoreCellsThanItMayLookAt) {
  // One sample of 20 x 20 m at 0.01 m covers 4.0 of 4.2 million cells.
  const TerrainScene scene(0.01f);
  const Rectangle large{-10, -10, 10, 10};
  const auto never = [] { return false; };
  EXPECT_TRUE(CheckPath(scene.map(), Ask({{0, 0}}, large), never).ok());
  const auto refused = CheckPath(scene.map(), Ask({{0, 0}, {0.01, 0}}, large), never);
  EXPECT_TRUE(absl::IsInvalidArgument(refused.status())) << refused.status();
  EXPECT_EQ(refused.status().message(),
            "path is such that its 2 samples cover more than 4194304 cells in all, want a shorter "
            "one, a longer step_m or a smaller footprint");
  // One step over 9 km, two milliard cells, is refused before they are looked at.
  EXPECT_FALSE(CheckPath(scene.map(), Ask({{0, 0}, {9000, 0}}, large, 1e5), never).ok());
}

TEST(CheckPath, StopsWhenNobodyWaits) {
  const TerrainScene scene;
  int looks = 0;
  const auto check =
      CheckPath(scene.map(), Ask({{0, 0}, {5000, 0}}, Disc{5}), [&looks] { return ++looks == 3; });
  EXPECT_TRUE(absl::IsCancelled(check.status())) << check.status();
  EXPECT_EQ(looks, 3);
}

TEST(CheckPath, WorksAtTheEdgeOfTheWorld) {
  const TerrainScene scene(0.01f);
  const PathCheck check = Check(
      scene, Ask({{1e6, 1e6}, {1e6 - 1, 1e6}, {1e6 - 1, 1e6 - 1}}, Rectangle{-1, -1, 1, 1}, 1));
  EXPECT_FALSE(check.free);
  EXPECT_EQ(check.samples.back().unknown_share, 1);
}

}  // namespace
}  // namespace gem
