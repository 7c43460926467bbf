// What a session contributed leaves the map, nothing else does, and it comes back.
#include <gtest/gtest.h>

#include "core/global/global_mapper.h"
#include "scenes.h"

namespace gem {
namespace {

using test::AtCells;
using test::CellOfMap;
using test::Flat;
using test::kSecond_ns;
using test::MakeLocalMap;
using test::MakeSubmap;
using test::NumKnown;
using test::SameCells;

GlobalMapOptions NoMerge() {
  GlobalMapOptions options;
  options.merge_overlap_min = 2;
  return options;
}

/// 40 x 40 cells of O from (x, 0) on.
std::shared_ptr<const Submap> Square(const std::string& session, std::int64_t stamp_s,
                                     std::int32_t x, float elevation_m) {
  return MakeSubmap(session, stamp_s * kSecond_ns, AtCells(x, 0), {{0, 0}, {40, 40}},
                    Flat(elevation_m));
}

/// A map of the sessions "a" and "b", or of one of them.
class Map {
 public:
  explicit Map(const GlobalMapOptions& options,
               const std::vector<std::string>& sessions = {"a", "b"})
      : mapper_(options, 1) {
    for (const std::string& session : sessions) {
      EXPECT_TRUE(mapper_.AddSession(session, "robot-" + session, {}).ok());
      SessionUpdate update;
      for (std::int64_t s = 0; s <= 100; ++s)
        update.odometry.push_back(
            {s * kSecond_ns, Pose<Odom, Base>::FromTranslation(static_cast<double>(s), 0, 0)});
      Tell(session, std::move(update));
    }
  }

  void Tell(const std::string& session, SessionUpdate update) {
    const absl::Status status = mapper_.Update(session, std::move(update));
    EXPECT_TRUE(status.ok()) << status;
  }
  void Finish(const std::shared_ptr<const Submap>& submap) {
    SessionUpdate update;
    update.finished = {submap};
    Tell(submap->origin().session, std::move(update));
  }
  void Raise(const std::string& session, double z_m) {
    CorrectedTrajectory correction;
    for (const std::int64_t s : {0, 100})
      correction.push_back(
          {s * kSecond_ns, Pose<Global, Base>::FromTranslation(static_cast<double>(s), 0, z_m)});
    EXPECT_TRUE(mapper_.Correct(session, correction).ok());
  }
  RetractionCounts Retract(const std::string& session) { return Change(session, false); }
  RetractionCounts Restore(const std::string& session) { return Change(session, true); }
  std::shared_ptr<const MapSnapshot> Commit() { return mapper_.Commit(CancelToken(), report_); }
  GlobalMapper& mapper() { return mapper_; }
  const CommitReport& report() const { return report_; }

 private:
  RetractionCounts Change(const std::string& session, bool restore) {
    const auto counts = mapper_.Retract(session, restore);
    EXPECT_TRUE(counts.ok()) << counts.status();
    return *counts;
  }

  GlobalMapper mapper_;
  CommitReport report_;
};

/// Cells of the map with a height of about z.
std::size_t NumAt(const MapSnapshot& snapshot, float z_m) {
  std::size_t count = 0;
  for (const auto& [index, tile] : snapshot.tiles)
    for (const CellBelief& cell : tile->cells)
      if (cell.known() && std::abs(cell.elevation_m - z_m) < 1e-4f) ++count;
  return count;
}

TEST(Retraction, LeavesTheMapOfTheOthers) {
  Map both(NoMerge()), alone(NoMerge(), {"a"});
  for (Map* map : {&both, &alone}) {
    map->Finish(Square("a", 1, 0, 0));
    map->Finish(Square("a", 9, 100, 0));
    SessionUpdate live;
    live.active = Square("a", 20, 200, 0);
    live.local_map = MakeLocalMap({230, 0}, 30, 1, 30 * kSecond_ns);
    map->Tell("a", live);
  }
  both.Finish(Square("b", 2, 20, 0.1f));
  SessionUpdate live;
  live.active = Square("b", 21, 210, 0.1f);
  live.local_map = MakeLocalMap({220, 10}, 30, 2, 31 * kSecond_ns);
  both.Tell("b", live);
  const auto before = both.Commit();

  const RetractionCounts counts = both.Retract("b");
  EXPECT_EQ(counts.num_submaps, 2u) << "a finished one and the active one";
  EXPECT_EQ(counts.num_merged_cells, 0u);
  const auto after = both.Commit();
  EXPECT_EQ(after->version.revision, before->version.revision + 1);
  const auto without = alone.Commit();
  EXPECT_TRUE(SameCells(*after, *without));
  EXPECT_EQ(after->num_points, without->num_points);
  EXPECT_EQ(after->submaps.size(), without->submaps.size());
  EXPECT_GT(after->submap_bytes, without->submap_bytes) << "what is hidden is still there";
  ASSERT_EQ(after->sessions.size(), 2u);
  EXPECT_FALSE(after->sessions[0].retracted);
  EXPECT_TRUE(after->sessions[1].retracted);
}

TEST(Retraction, OfAnActiveSessionLetsItGoOnUnseen) {
  Map map(NoMerge()), never(NoMerge());
  map.Retract("b");
  for (Map* each : {&map, &never}) {
    each->Finish(Square("b", 2, 20, 0.1f));
    SessionUpdate live;
    live.active = Square("b", 21, 210, 0.1f);
    live.local_map = MakeLocalMap({220, 10}, 30, 2, 31 * kSecond_ns);
    each->Tell("b", live);
    each->Raise("b", 0.5);
  }
  EXPECT_EQ(NumKnown(*map.Commit()), 0u);
  map.Restore("b");
  EXPECT_TRUE(SameCells(*map.Commit(), *never.Commit())) << "the correction as well";
}

// Overlap: 20 x 40 cells. Both see it within 300 s of each other, so it is fused to 0.05 m.
TEST(Retraction, TakesCellsOutOfOthersSubmaps) {
  Map map({});
  map.Finish(Square("a", 1, 0, 0));
  map.Commit();
  map.Finish(Square("b", 2, 20, 0.1f));
  const auto merged = map.Commit();
  ASSERT_EQ(merged->submaps.size(), 1u);
  EXPECT_EQ(NumAt(*merged, 0.05f), 800u);
  EXPECT_EQ(merged->submaps[0].contributors, (ContributorSet{{"a", "robot-a"}, {"b", "robot-b"}}));

  const RetractionCounts gone = map.Retract("b");
  EXPECT_EQ(gone.num_submaps, 0u);
  EXPECT_EQ(gone.num_merged_cells, 1600u) << "fused ones, and those that it had alone";
  const auto without = map.Commit();
  EXPECT_EQ(NumAt(*without, 0), 800u);
  EXPECT_EQ(NumKnown(*without), 800u) << "what was fused is not known to be anything";
  EXPECT_EQ(without->submaps[0].contributors, (ContributorSet{{"a", "robot-a"}}));

  EXPECT_EQ(map.Restore("b").num_merged_cells, 1600u);
  EXPECT_TRUE(SameCells(*map.Commit(), *merged));
}

TEST(Retraction, LeavesOthersCellsInItsOwnSubmaps) {
  Map map({});
  map.Finish(Square("b", 1, 0, 0));
  map.Commit();
  map.Finish(Square("a", 2, 20, 0.1f));
  const auto merged = map.Commit();
  ASSERT_EQ(merged->submaps.size(), 1u);
  const RetractionCounts gone = map.Retract("b");
  EXPECT_EQ(gone.num_submaps, 0u) << "there is something left of it";
  EXPECT_EQ(gone.num_merged_cells, 800u) << "the fused ones";
  const auto without = map.Commit();
  EXPECT_EQ(NumAt(*without, 0.1f), 800u);
  EXPECT_EQ(NumKnown(*without), 800u);
  // They hang on its trajectory, and go on to follow it.
  map.Raise("b", 1);
  EXPECT_EQ(NumAt(*map.Commit(), 1.1f), 800u);
  map.Raise("b", 0);
  map.Restore("b");
  EXPECT_TRUE(SameCells(*map.Commit(), *merged));
}

TEST(Retraction, WhatTheNewerReplacedIsTheNewerOnesAlone) {
  Map map({});
  map.Finish(Square("a", 1, 0, 0));
  map.Commit();
  // 400 s later: beyond merge_fuse_time_s_max.
  map.Finish(MakeSubmap("b", 2 * kSecond_ns, AtCells(0, 0), {{0, 0}, {40, 30}}, Flat(0.1f),
                        401 * kSecond_ns));
  ASSERT_EQ(map.Commit()->submaps.size(), 1u);
  map.Retract("a");
  const auto without = map.Commit();
  EXPECT_EQ(NumAt(*without, 0.1f), 1200u);
  EXPECT_EQ(NumKnown(*without), 1200u);
}

TEST(Retraction, HundredRoundsLeaveTheSameBytes) {
  for (const GlobalMapOptions& options : {NoMerge(), GlobalMapOptions{}}) {
    Map map(options);
    for (int i = 0; i < 5; ++i) {
      map.Finish(Square("a", 2 * i + 1, 30 * i, 0.02f * static_cast<float>(i)));
      map.Finish(Square("b", 2 * i + 2, 30 * i + 12, 0.03f * static_cast<float>(i)));
      map.Commit();
    }
    SessionUpdate live;
    live.active = Square("b", 21, 150, 0.1f);
    live.local_map = MakeLocalMap({150, 10}, 30, 2, 31 * kSecond_ns);
    map.Tell("b", live);
    const auto first = map.Commit();
    for (int round = 0; round < 100; ++round) {
      for (const std::string session : {round % 3 == 0 ? "a" : "b"}) {
        map.Retract(session);
        EXPECT_FALSE(SameCells(*map.Commit(), *first));
        EXPECT_EQ(map.report().num_merged_submaps, 0u);
        map.Restore(session);
        ASSERT_TRUE(SameCells(*map.Commit(), *first)) << "round " << round;
        EXPECT_EQ(map.report().num_merged_submaps, 0u);
      }
    }
    const auto last = map.Commit();
    EXPECT_EQ(last->num_points, first->num_points);
    EXPECT_EQ(last->submap_bytes, first->submap_bytes);
    EXPECT_EQ(last->newest_stamp_ns, first->newest_stamp_ns);
    ASSERT_EQ(last->submaps.size(), first->submaps.size());
    for (std::size_t i = 0; i < last->submaps.size(); ++i) {
      EXPECT_EQ(last->submaps[i].origin.id, first->submaps[i].origin.id);
      EXPECT_EQ(last->submaps[i].first_stamp_ns, first->submaps[i].first_stamp_ns);
    }
  }
}

TEST(Retraction, WhatOthersMappedMeanwhileStaysWhenItIsRestored) {
  Map map({});
  map.Finish(Square("a", 1, 0, 0));
  map.Commit();
  map.Finish(Square("b", 2, 20, 0.1f));
  map.Commit();
  map.Retract("b");
  map.Commit();
  // "a" comes again, long after, to where both had been.
  map.Finish(MakeSubmap("a", 3 * kSecond_ns, AtCells(0, 0), {{0, 0}, {40, 40}}, Flat(0.2f),
                        900 * kSecond_ns));
  const auto meanwhile = map.Commit();
  ASSERT_EQ(meanwhile->submaps.size(), 1u) << "half of it lies on what is left of the first";
  EXPECT_EQ(NumAt(*meanwhile, 0.2f), 1600u);
  EXPECT_EQ(map.Restore("b").num_merged_cells, 800u) << "20 columns: the rest is mapped anew";
  const auto restored = map.Commit();
  EXPECT_EQ(NumAt(*restored, 0.2f), 1600u);
  EXPECT_EQ(NumAt(*restored, 0.1f), 800u);
  EXPECT_EQ(NumAt(*restored, 0.05f), 0u) << "what had been fused is gone for good";
}

TEST(Retraction, AFusedCellComesBackWithTheLastOfItsSessions) {
  Map map({});
  map.Finish(Square("a", 1, 0, 0));
  map.Commit();
  map.Finish(Square("b", 2, 20, 0.1f));
  const auto merged = map.Commit();
  map.Retract("b");
  map.Retract("a");
  EXPECT_EQ(NumKnown(*map.Commit()), 0u);
  map.Restore("b");
  const auto only_b = map.Commit();
  EXPECT_EQ(NumAt(*only_b, 0.1f), 800u);
  EXPECT_EQ(NumKnown(*only_b), 800u);
  map.Restore("a");
  EXPECT_TRUE(SameCells(*map.Commit(), *merged));
}

TEST(Retraction, WhatComesBackToAChangedMapIsMerged) {
  Map map({});
  map.Finish(Square("b", 2, 0, 0));
  map.Commit();
  map.Retract("b");
  map.Commit();
  map.Finish(Square("a", 1, 0, 0.1f));
  EXPECT_EQ(map.Commit()->submaps.size(), 1u);
  map.Restore("b");
  const auto merged = map.Commit();
  EXPECT_EQ(map.report().num_merged_submaps, 1u);
  EXPECT_EQ(merged->submaps.size(), 1u);
  EXPECT_EQ(NumAt(*merged, 0.05f), 1600u);
}

TEST(Retraction, OfWhatIsRetractedAlreadyChangesNothing) {
  Map map({});
  map.Finish(Square("a", 1, 0, 0));
  const auto first = map.Commit();
  EXPECT_EQ(map.Restore("a").num_submaps, 0u);
  EXPECT_EQ(map.Commit(), first);
  EXPECT_EQ(map.Retract("a").num_submaps, 1u);
  const auto retracted = map.Commit();
  EXPECT_EQ(map.Retract("a").num_submaps, 0u);
  EXPECT_EQ(map.Commit(), retracted);
  EXPECT_EQ(map.mapper().Retract("x", false).status().code(), absl::StatusCode::kNotFound);
}

TEST(Retraction, OfASessionWithoutCellsIsARevisionToo) {
  Map map({});
  const auto first = map.Commit();
  map.Retract("a");
  EXPECT_EQ(map.Commit()->version.revision, first->version.revision + 1);
}

TEST(Retraction, IsNotLostWhenARenderingIsCancelled) {
  Map map(NoMerge());
  map.Finish(Square("a", 1, 0, 0));
  map.Finish(Square("b", 2, 100, 0));
  map.Commit();
  map.Retract("b");
  CancelToken cancel;
  cancel.Cancel();
  CommitReport report;
  EXPECT_EQ(NumKnown(*map.mapper().Commit(cancel, report)), 3200u);
  EXPECT_EQ(NumKnown(*map.Commit()), 1600u);
}

TEST(Sources, OfASubmapOfOneSessionCostNothingACell) {
  const auto own = Square("a", 1, 0, 0);
  const auto other = MakeSubmap("a", kSecond_ns, {}, {{0, 0}, {40, 41}}, Flat(0));
  EXPECT_EQ((other->size_bytes() - own->size_bytes()) / 40, 37u) << "as before there were sources";
  EXPECT_EQ(own->source(1599), 0u);
}

TEST(Sources, TakeAByteACellOrTwoBeyond256) {
  const auto with = [](std::size_t num_sources) {
    Sources sources;
    // In the wrong order, and one that nobody has.
    for (std::size_t i = num_sources + 1; i-- > 0;)
      sources.push_back({{"s" + std::to_string(10'000 + i), "r"}});
    std::vector<KeyedSubmapCell> cells;
    for (std::size_t i = 0; i < 1000; ++i)
      cells.push_back({{static_cast<std::int32_t>(i), 0},
                       test::Cell(0, 1),
                       static_cast<SourceIndex>(1 + i % num_sources)});
    return Submap({}, cells, {}, sources);
  };
  for (const std::size_t num_sources : {std::size_t{2}, std::size_t{256}, std::size_t{700}}) {
    const Submap submap = with(num_sources);
    ASSERT_EQ(submap.sources().size(), num_sources);
    EXPECT_TRUE(std::is_sorted(submap.sources().begin(), submap.sources().end()));
    for (std::size_t i = 0; i < 1000; ++i) {
      const std::size_t name = num_sources - 1 - i % num_sources;
      const std::size_t position = *submap.Find({static_cast<std::int32_t>(i), 0});
      ASSERT_EQ(submap.sources()[submap.source(position)].front().session,
                "s" + std::to_string(10'000 + name));
      ASSERT_EQ(submap.Cells()[position].source, submap.source(position));
    }
  }
}

TEST(Sources, AreUnitedOnceAndKeepTheOlderOnesNumbers) {
  const Contributor a{"a", "r"}, b{"b", "r"}, c{"c", "r"};
  JoinedSources joined({{a}, {a, b}}, {{b}, {c}, {a, b}});
  EXPECT_EQ(joined.OfNewer(0), 2);
  EXPECT_EQ(joined.OfNewer(1), 3);
  EXPECT_EQ(joined.OfNewer(2), 1);
  EXPECT_EQ(joined.Union(0, 2), 1) << "a with b is there already";
  EXPECT_EQ(joined.Union(1, 3), 4);
  EXPECT_EQ(joined.Union(3, 1), 4);
  EXPECT_EQ(joined.Union(4, 0), 4);
  EXPECT_FALSE(joined.full());
  const Sources sources = joined.Take();
  ASSERT_EQ(sources.size(), 5u);
  EXPECT_EQ(sources[4], (ContributorSet{a, b, c}));
}

}  // namespace
}  // namespace gem
