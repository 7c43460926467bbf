#include "core/global/submap_merger.h"

#include <gtest/gtest.h>

#include <cmath>

#include "scenes.h"

namespace gem {
namespace {

using test::Flat;
using test::kSecond_ns;
using test::MakeSubmap;

PlacedSubmap Placed(std::uint64_t id, const std::shared_ptr<const Submap>& submap,
                    const Pose<Global, Submap>& T_G_K = {}) {
  return Place(SubmapId{id}, submap, true, T_G_K);
}

std::shared_ptr<const Submap> Square(const std::string& session, std::int64_t stamp_s,
                                     std::int32_t x, float elevation_m) {
  return MakeSubmap(session, stamp_s * kSecond_ns, {}, {{x, 0}, {x + 40, 40}}, Flat(elevation_m));
}

TEST(ShouldMerge, NeedsHalfOfTheNewerOnesCells) {
  const PlacedSubmap older = Placed(1, Square("a", 1, 0, 0));
  EXPECT_TRUE(ShouldMerge(older, Placed(2, Square("a", 2, 20, 0)), {}));
  EXPECT_FALSE(ShouldMerge(older, Placed(2, Square("a", 2, 21, 0)), {}));
}

TEST(ShouldMerge, AnotherFloorIsNotTheSameGround) {
  const PlacedSubmap older = Placed(1, Square("a", 1, 0, 0));
  EXPECT_TRUE(ShouldMerge(older, Placed(2, Square("a", 2, 0, 0.29f)), {}));
  EXPECT_FALSE(ShouldMerge(older, Placed(2, Square("a", 2, 0, 3.0f)), {}));
}

TEST(Merge, FusesWithinTheTimeAndReplacesBeyondIt) {
  const PlacedSubmap older = Placed(1, Square("a", 1, 0, 0));
  const auto within = Merge(older, Placed(2, Square("a", 301, 0, 0.1f)), {});
  EXPECT_NEAR(within->At(0).elevation_m, 0.05f, 1e-6);
  const auto beyond = Merge(older, Placed(2, Square("a", 302, 0, 0.1f)), {});
  EXPECT_NEAR(beyond->At(0).elevation_m, 0.1f, 1e-6);
}

TEST(Merge, TheNewerObservationWinsWhicheverSubmapItIsIn) {
  // The older submap saw its cells again, after the newer one.
  const auto refreshed = MakeSubmap("a", 1, {}, {{0, 0}, {40, 40}}, Flat(5), 900 * kSecond_ns);
  const auto merged = Merge(Placed(1, refreshed), Placed(2, Square("a", 2, 0, 0)), {});
  EXPECT_EQ(merged->At(0).elevation_m, 5);
}

TEST(Merge, AFrozenPedestrianVanishesWhenItsPlaceIsMappedAgain) {
  const auto with_pedestrian = MakeSubmap("a", kSecond_ns, {}, {{0, 0}, {40, 40}}, [](CellIndex c) {
    return c == CellIndex{10, 10} ? 1.8f : 0.0f;
  });
  // Both soon after and long after.
  for (const std::int64_t stamp_s : {60, 4000}) {
    const auto merged =
        Merge(Placed(1, with_pedestrian), Placed(2, Square("a", stamp_s, 0, 0)), {});
    EXPECT_NEAR(merged->elevation_m(*merged->Find({10, 10})), 0, 1e-6);
    EXPECT_EQ(merged->num_cells(), 1600u);
  }
}

TEST(Merge, KeepsTheOlderOnesOriginAndNamesAllRobots) {
  const auto merged = Merge(Placed(1, Square("b", 1, 0, 0)), Placed(2, Square("a", 2, 0, 0)), {});
  EXPECT_EQ(merged->origin().session, "b");
  EXPECT_EQ(merged->origin().anchor_stamp_ns, kSecond_ns);
  EXPECT_EQ(AllContributors(merged->sources()),
            (ContributorSet{{"a", "robot-a"}, {"b", "robot-b"}}));
}

// What is merged into a submap was placed by another stretch of the way, or another robot.
TEST(Merge, CorrectionsMoveTheResultByWhatTheOlderOneMapped) {
  const auto older = Square("a", 1, 0, 0);
  const auto merged = Merge(Placed(1, older), Placed(2, Square("b", 2, 20, 0)), {});
  ASSERT_NE(merged, nullptr);
  EXPECT_GT(merged->num_cells(), older->num_cells());
  ASSERT_EQ(merged->parts().size(), older->parts().size());
  EXPECT_EQ(merged->parts().front().num_cells, older->parts().front().num_cells);
}

TEST(Merge, LeavesNoHolesWhenTheSubmapsAreTurned) {
  const PlacedSubmap older = Placed(1, Square("a", 1, 0, 1));
  const auto newer = MakeSubmap("a", 2 * kSecond_ns, {}, {{-60, -60}, {60, 60}}, Flat(1));
  const Pose<Global, Submap> T_G_K = Pose<Global, Submap>::FromYaw(0.5, {4, 4, 0});
  const auto merged = Merge(older, Placed(2, newer, T_G_K), {});
  // Half of 24 m minus the way of the middle: a square of 8 m radius lies inside for sure.
  for (CellIndex c{-20, -20}; c.y < 60; ++c.y) {
    for (c.x = -20; c.x < 60; ++c.x) {
      const double away_m = std::hypot(CenterOf(c.x, 0.2) - 4, CenterOf(c.y, 0.2) - 4);
      if (away_m > 11) continue;
      ASSERT_TRUE(merged->Find(c).has_value()) << c.x << " " << c.y;
    }
  }
}

TEST(Merge, TurnsTheCovarianceWithThePoint) {
  SubmapOrigin origin;
  origin.session = "a";
  origin.cell_size_m = 0.2f;
  origin.anchor_stamp_ns = 2;
  SubmapCell cell = test::Cell(0, 5);
  cell.covariance_m2 = {0.4f, 0.1f, 0.03f, 0.2f, 0.02f, 0.05f};
  const auto newer =
      std::make_shared<const Submap>(origin, std::vector<KeyedSubmapCell>{{{0, 0}, cell}});
  const auto older = Square("a", 1, 100, 0);
  // A quarter turn: x of the newer one is y of the older, y is -x.
  const auto merged = Merge(
      Placed(1, older), Placed(2, newer, Pose<Global, Submap>::FromYaw(M_PI / 2, {2, 2, 0})), {});
  // The middle (0.1, 0.1) comes to (1.9, 2.1).
  const Covariance3 c = merged->covariance_m2(*merged->Find({9, 10}));
  const Covariance3 want{0.2f, -0.1f, -0.02f, 0.4f, 0.03f, 0.05f};
  for (std::size_t i = 0; i < 6; ++i) EXPECT_NEAR(c[i], want[i], 1e-6) << i;
}

TEST(Merge, DoesNotGrowBeyondWhatASubmapMaySpan) {
  const PlacedSubmap older = Placed(1, Square("a", 1, 0, 0));
  EXPECT_EQ(Merge(older, Placed(2, Square("a", 2, kSubmapSideCells_max, 0)), {}), nullptr);
}

TEST(Maintain, ACrossingThatIsNearerDoesNotHideTheStreet) {
  // The street driven again lies shifted along itself; a crossing street's middle is nearer.
  const auto street = MakeSubmap("a", 1 * kSecond_ns, {}, {{-60, -10}, {60, 10}}, Flat(0));
  const auto crossing = MakeSubmap("a", 2 * kSecond_ns, {}, {{10, -60}, {30, 60}}, Flat(0));
  const auto again = MakeSubmap("a", 3 * kSecond_ns, {}, {{-40, -10}, {80, 10}}, Flat(0));
  std::vector<std::shared_ptr<const PlacedSubmap>> submaps;
  std::uint64_t id = 0;
  for (const auto& submap : {street, crossing, again})
    submaps.push_back(std::make_shared<const PlacedSubmap>(Placed(++id, submap)));
  CancelToken cancel;
  const Maintenance result = Maintain(submaps, {SubmapId{3}}, {}, cancel);
  EXPECT_EQ(result.num_merged, 1u);
  ASSERT_EQ(result.submaps.size(), 2u);
  EXPECT_EQ(result.submaps[0]->submap->num_cells(), 140u * 20);
  EXPECT_EQ(result.submaps[1]->submap->num_cells(), crossing->num_cells());
  EXPECT_EQ(result.submaps[1]->submap->last_stamp_ns(), 3 * kSecond_ns) << "its middle, seen again";
}

Maintenance MaintainLast(const std::vector<std::shared_ptr<const Submap>>& all) {
  std::vector<std::shared_ptr<const PlacedSubmap>> submaps;
  for (const auto& submap : all)
    submaps.push_back(std::make_shared<const PlacedSubmap>(Placed(submaps.size() + 1, submap)));
  CancelToken cancel;
  return Maintain(submaps, {SubmapId{all.size()}}, {}, cancel);
}

// Round the block for an hour: each round's submaps lie on two of the first round's. What went into
// one of them with all its cells grew it over its neighbour, round by round.
TEST(Maintain, NoGroundIsStoredTwice) {
  const auto first = Square("a", 1, 0, 0), second = Square("a", 2, 40, 0);
  const Maintenance result = MaintainLast({first, second, Square("a", 3, 15, 0)});
  ASSERT_EQ(result.num_merged, 1u);
  ASSERT_EQ(result.submaps.size(), 2u);
  for (const auto& placed : result.submaps) {
    EXPECT_EQ(placed->submap->num_cells(), 40u * 40);
    EXPECT_EQ(placed->submap->last_stamp_ns(), 3 * kSecond_ns) << "both were seen again";
  }
}

TEST(Maintain, WhatLiesOnSeveralIsMergedIntoTheOneThatKnowsTheMostOfIt) {
  // A third on each, and a strip of 10 cells beside them that nobody knows yet.
  const auto across = MakeSubmap("a", 3 * kSecond_ns, {}, {{25, -10}, {53, 40}}, Flat(0));
  const auto gap = MakeSubmap("a", 2 * kSecond_ns, {}, {{40, 0}, {80, 40}}, Flat(0));
  const PlacedSubmap one = Placed(1, Square("a", 1, 0, 0));
  EXPECT_FALSE(ShouldMerge(one, Placed(3, across), {}));
  EXPECT_FALSE(ShouldMerge(Placed(2, gap), Placed(3, across), {}));
  const Maintenance result = MaintainLast({one.submap, gap, across});
  ASSERT_EQ(result.submaps.size(), 2u);
  EXPECT_EQ(result.submaps[0]->submap->num_cells(), 40u * 40 + 28u * 10) << "with the new strip";
  EXPECT_EQ(result.submaps[1]->submap->num_cells(), 40u * 40);
}

TEST(Maintain, DoesNotDependOnTheOrderOfArrival) {
  const auto a = Square("a", 1, 0, 0), b = Square("b", 2, 10, 0.1f), c = Square("c", 3, 15, 0.05f);
  const auto maintain = [](std::vector<std::shared_ptr<const Submap>> order) {
    std::vector<std::shared_ptr<const PlacedSubmap>> submaps;
    absl::flat_hash_set<SubmapId> changed;
    for (std::size_t i = 0; i < order.size(); ++i) {
      submaps.push_back(std::make_shared<const PlacedSubmap>(Placed(i + 1, order[i])));
      changed.insert(SubmapId{i + 1});
    }
    CancelToken cancel;
    return Maintain(std::move(submaps), changed, {}, cancel);
  };
  const Maintenance one = maintain({a, b, c});
  const Maintenance other = maintain({c, a, b});
  ASSERT_EQ(one.submaps.size(), 1u);
  ASSERT_EQ(other.submaps.size(), 1u);
  const auto x = one.submaps[0]->submap->Cells(), y = other.submaps[0]->submap->Cells();
  ASSERT_EQ(x.size(), y.size());
  for (std::size_t i = 0; i < x.size(); ++i) ASSERT_EQ(x[i].value, y[i].value);
}

TEST(Maintain, CanBeCancelled) {
  const auto a = std::make_shared<const PlacedSubmap>(Placed(1, Square("a", 1, 0, 0)));
  const auto b = std::make_shared<const PlacedSubmap>(Placed(2, Square("a", 2, 0, 0)));
  CancelToken cancel;
  cancel.Cancel();
  EXPECT_TRUE(Maintain({a, b}, {SubmapId{2}}, {}, cancel).cancelled);
}

}  // namespace
}  // namespace gem
