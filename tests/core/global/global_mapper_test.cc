#include "core/global/global_mapper.h"

#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <thread>

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

constexpr double kCell_m = 0.2f;

Pose<Odom, Base> BaseAt(double x_m, double y_m = 0) {
  return Pose<Odom, Base>::FromTranslation(x_m, y_m, 0);
}

std::vector<StampedPose<Odom, Base>> Odometry(std::int64_t first_s, std::int64_t last_s) {
  std::vector<StampedPose<Odom, Base>> odometry;
  for (std::int64_t s = first_s; s <= last_s; ++s)
    odometry.push_back({s * kSecond_ns, BaseAt(static_cast<double>(s))});
  return odometry;
}

/// Corrects all of Odometry() by one rigid move.
CorrectedTrajectory Moved(const Pose<Global, Odom>& T_G_O, std::int64_t first_s,
                          std::int64_t last_s) {
  CorrectedTrajectory correction;
  for (const auto& pose : Odometry(first_s, last_s))
    correction.push_back({pose.stamp_ns, T_G_O * pose.T_A_B});
  return correction;
}

GlobalMapOptions NoMerge() {
  GlobalMapOptions options;
  options.merge_overlap_min = 2;
  return options;
}

/// A map of one session "s" with odometry for stamps 0..100 s.
class OneSession : public testing::Test {
 protected:
  explicit OneSession(const GlobalMapOptions& options = NoMerge()) : mapper_(options, 42) {
    EXPECT_TRUE(mapper_.AddSession("s", "r", {}).ok());
    Tell({.odometry = Odometry(0, 100)});
  }

  void Tell(SessionUpdate update) {
    const absl::Status status = mapper_.Update("s", std::move(update));
    EXPECT_TRUE(status.ok()) << status;
  }
  void Finish(const std::shared_ptr<const Submap>& submap) { Tell({.finished = {submap}}); }
  void MoveTo(const Pose<Global, Odom>& T_G_O) {
    EXPECT_TRUE(mapper_.Correct("s", Moved(T_G_O, 0, 100)).ok());
  }
  std::shared_ptr<const MapSnapshot> Commit() { return mapper_.Commit(go_, report_); }

  GlobalMapper mapper_;
  CancelToken go_;
  CommitReport report_;
};

std::shared_ptr<const Submap> SquareAt(std::int64_t anchor_s, std::int32_t x, std::int32_t y,
                                       float elevation_m, std::int64_t stamp_s = 0,
                                       const std::string& session = "s") {
  return MakeSubmap(session, anchor_s * kSecond_ns, AtCells(x, y), {{0, 0}, {20, 20}},
                    Flat(elevation_m), stamp_s * kSecond_ns);
}

TEST_F(OneSession, CellsAppearWhereTheyAre) {
  Finish(SquareAt(1, -10, 200, 1.5f));
  const auto snapshot = Commit();
  EXPECT_EQ(NumKnown(*snapshot), 400u);
  for (CellIndex c{-10, 200}; c.y < 220; ++c.y) {
    for (c.x = -10; c.x < 10; ++c.x) {
      ASSERT_EQ(CellOfMap(*snapshot, c).elevation_m, 1.5f);
      ASSERT_EQ(CellOfMap(*snapshot, c).stamp_ns, kSecond_ns);
      ASSERT_EQ(CellOfMap(*snapshot, c).state, kCellKnown | kCellAnnotated);
    }
  }
  EXPECT_EQ(snapshot->tiles.size(), 2u) << "(-1, 1) and (0, 1)";
  EXPECT_EQ(snapshot->num_points, 400u);
  EXPECT_EQ(snapshot->newest_stamp_ns, kSecond_ns);
  EXPECT_EQ(snapshot->version.epoch, 42u);
}

TEST_F(OneSession, TheActiveSubmapShowsLikeAFinishedOne) {
  Tell({.active = SquareAt(1, 0, 0, 1)});
  auto snapshot = Commit();
  EXPECT_EQ(NumKnown(*snapshot), 400u);
  ASSERT_EQ(snapshot->submaps.size(), 1u);
  EXPECT_FALSE(snapshot->submaps[0].finished);
  const SubmapId id = snapshot->submaps[0].origin.id;
  Tell({.finished = {SquareAt(1, 0, 0, 1)}, .active = SquareAt(50, 20, 0, 1)});
  snapshot = Commit();
  EXPECT_EQ(NumKnown(*snapshot), 800u);
  ASSERT_EQ(snapshot->submaps.size(), 2u);
  EXPECT_EQ(snapshot->submaps[0].origin.id, id) << "it keeps its id";
  EXPECT_TRUE(snapshot->submaps[0].finished);
}

TEST_F(OneSession, AnActiveSubmapThatIsGoneLeavesNothing) {
  Tell({.active = SquareAt(1, 0, 0, 1)});
  Commit();
  Tell({});
  EXPECT_TRUE(Commit()->tiles.empty());
}

TEST_F(OneSession, ACorrectionMovesEverySubmapTheFirstToo) {
  Finish(SquareAt(0, 0, 0, 1));
  Finish(SquareAt(50, 1000, 0, 1));
  Commit();
  MoveTo(Pose<Global, Odom>::FromTranslation(7 * kCell_m, 0, 0.5));
  const auto snapshot = Commit();
  EXPECT_EQ(report_.num_moved_submaps, 2u);
  EXPECT_FALSE(CellOfMap(*snapshot, {6, 0}).known());
  EXPECT_EQ(CellOfMap(*snapshot, {7, 0}).elevation_m, 1.5f);
  EXPECT_EQ(CellOfMap(*snapshot, {26, 0}).elevation_m, 1.5f);
  EXPECT_FALSE(CellOfMap(*snapshot, {27, 0}).known());
  EXPECT_TRUE(CellOfMap(*snapshot, {1007, 0}).known());
}

TEST_F(OneSession, SubmapsFollowThePoseOfTheirOwnStamp) {
  Finish(SquareAt(10, 50, 0, 0));
  Finish(SquareAt(20, 100, 0, 0));
  Finish(SquareAt(30, 150, 0, 0));
  // Keyframes of SLAM are not our submaps: 10 s stays, 30 s rises by 2 m.
  ASSERT_TRUE(mapper_
                  .Correct("s", {{10 * kSecond_ns, Pose<Global, Base>::FromTranslation(10, 0, 0)},
                                 {30 * kSecond_ns, Pose<Global, Base>::FromTranslation(30, 0, 2)}})
                  .ok());
  const auto snapshot = Commit();
  EXPECT_NEAR(CellOfMap(*snapshot, {55, 5}).elevation_m, 0, 1e-6);
  EXPECT_NEAR(CellOfMap(*snapshot, {105, 5}).elevation_m, 1, 1e-6);
  EXPECT_NEAR(CellOfMap(*snapshot, {155, 5}).elevation_m, 2, 1e-6);
}

TEST_F(OneSession, AHundredCorrectionsAndBackGiveTheSameBytes) {
  for (int i = 0; i < 5; ++i)
    Finish(MakeSubmap("s", i * 10 * kSecond_ns, AtCells(i * 50, i * 3, 0.25 * i),
                      {{-20, -20}, {20, 20}},
                      [](CellIndex c) { return 0.01f * static_cast<float>(c.x * c.x - c.y); }));
  Tell({.active = SquareAt(60, 300, 0, 1), .local_map = MakeLocalMap({320, 0}, 40, 1, kSecond_ns)});
  const auto first = Commit();
  for (int i = 1; i <= 100; ++i) {
    MoveTo(Pose<Global, Odom>(Eigen::Quaterniond(1, 0.001 * i, -0.0005 * i, 0.01 * i).normalized(),
                              {0.37 * i, -1.0 * i, 0.1}));
    Commit();
  }
  MoveTo({});
  const auto last = Commit();
  EXPECT_TRUE(SameCells(*first, *last));
  for (std::size_t i = 0; i < first->submaps.size(); ++i)
    EXPECT_TRUE(Identical(first->submaps[i].T_G_K, last->submaps[i].T_G_K));
}

TEST_F(OneSession, TenCorrectionsInARowAreTheLastOne) {
  for (int i = 0; i < 5; ++i) Finish(SquareAt(10 * i, 15 * i, 0, 0.1f * static_cast<float>(i)));
  const auto turn = [](int i) {
    return Pose<Global, Odom>::FromYaw(0.1 * i, {1.0 * i, 0, 0.3 * i});
  };
  for (int i = 1; i <= 10; ++i) {
    MoveTo(turn(i));
    if (i % 3 == 0) Commit();
  }
  const auto many = Commit();

  GlobalMapper once(NoMerge(), 1);
  ASSERT_TRUE(once.AddSession("s", "r", {}).ok());
  SessionUpdate update{.odometry = Odometry(0, 100)};
  for (int i = 0; i < 5; ++i)
    update.finished.push_back(SquareAt(10 * i, 15 * i, 0, 0.1f * static_cast<float>(i)));
  ASSERT_TRUE(once.Update("s", std::move(update)).ok());
  ASSERT_TRUE(once.Correct("s", Moved(turn(10), 0, 100)).ok());
  EXPECT_TRUE(SameCells(*many, *once.Commit(go_, report_)));
}

TEST_F(OneSession, OnlyTouchedTilesAreRendered) {
  Finish(SquareAt(10, 0, 0, 0));
  Finish(SquareAt(60, 128 * 10, 0, 0));
  Commit();
  EXPECT_EQ(report_.num_touched_tiles, 2u);
  // The submap of 60 s moves within its tile, that of 10 s stays.
  ASSERT_TRUE(
      mapper_
          .Correct("s", {{10 * kSecond_ns, Pose<Global, Base>::FromTranslation(10, 0, 0)},
                         {60 * kSecond_ns, Pose<Global, Base>::FromTranslation(60, kCell_m, 0)}})
          .ok());
  const auto snapshot = Commit();
  EXPECT_EQ(report_.num_moved_submaps, 1u);
  EXPECT_EQ(report_.num_touched_tiles, 1u);
  EXPECT_EQ(snapshot->tiles.at({0, 0})->version.revision, 1u);
  EXPECT_EQ(snapshot->tiles.at({10, 0})->version.revision, 2u);
}

TEST_F(OneSession, AGrowingActiveSubmapMarksOnlyWhereItGrew) {
  const auto grown = [](std::int32_t width) {
    return MakeSubmap("s", kSecond_ns, AtCells(0, 0), {{0, 0}, {width, 20}}, Flat(0));
  };
  Tell({.active = grown(400)});
  Commit();
  EXPECT_EQ(report_.num_touched_tiles, 4u);
  Tell({.active = grown(410)});
  const auto snapshot = Commit();
  EXPECT_EQ(report_.num_touched_tiles, 1u);
  EXPECT_EQ(NumKnown(*snapshot), 410u * 20);
}

TEST_F(OneSession, NothingNewIsNoNewRevision) {
  Tell({.active = SquareAt(1, 0, 0, 1), .local_map = MakeLocalMap({0, 0}, 10, 2, kSecond_ns)});
  const auto first = Commit();
  EXPECT_EQ(Commit(), first);
  // The same again, as new objects.
  Tell({.active = SquareAt(1, 0, 0, 1), .local_map = MakeLocalMap({0, 0}, 10, 2, kSecond_ns)});
  EXPECT_EQ(Commit(), first);
  // A correction that changes nothing.
  MoveTo({});
  EXPECT_EQ(Commit(), first);
  EXPECT_EQ(first->version.revision, 1u);
}

TEST_F(OneSession, AMapThatIsMovedAwayLeavesNoTileBehind) {
  Finish(SquareAt(10, 0, 0, 0));
  Commit();
  MoveTo(Pose<Global, Odom>::FromTranslation(1e6, -1e6, 0));
  const auto snapshot = Commit();
  EXPECT_FALSE(snapshot->tiles.contains({0, 0}));
  EXPECT_LE(snapshot->tiles.size(), 4u);
  EXPECT_GE(NumKnown(*snapshot), 400u);
  EXPECT_EQ(snapshot->tiles.begin()->second->index, snapshot->tiles.begin()->first);
}

TEST_F(OneSession, AgreeingSubmapsAreFusedByInverseVariance) {
  Finish(SquareAt(1, 0, 0, 1.0f, 5));
  Finish(SquareAt(2, 0, 0, 1.2f, 6));
  const CellBelief cell = CellOfMap(*Commit(), {3, 3});
  EXPECT_NEAR(cell.elevation_m, 1.1f, 1e-6);
  EXPECT_NEAR(cell.variance_m2, 0.005f, 1e-8);
  EXPECT_EQ(cell.stamp_ns, 6 * kSecond_ns);
}

TEST_F(OneSession, WhereSubmapsDisagreeTheNewerObservationWins) {
  // Two floors, 3 m apart: never 1.5 m. The older submap holds the newer observation.
  Finish(SquareAt(1, 0, 0, 3.0f, 9));
  Finish(SquareAt(2, 0, 0, 0.0f, 5));
  EXPECT_EQ(CellOfMap(*Commit(), {3, 3}).elevation_m, 3.0f);
}

TEST_F(OneSession, TheNewestObservationIsNotOutvotedByTwoOlderOnes) {
  Finish(SquareAt(1, 0, 0, 0.0f, 1));
  Finish(SquareAt(2, 0, 0, 0.0f, 2));
  Finish(SquareAt(3, 0, 0, 2.0f, 3));
  const CellBelief cell = CellOfMap(*Commit(), {3, 3});
  EXPECT_EQ(cell.elevation_m, 2.0f);
  EXPECT_NEAR(cell.variance_m2, 0.01f, 1e-8);
}

TEST_F(OneSession, TheVarianceIsTurnedIntoG) {
  Finish(SquareAt(10, -10, -10, 0));
  // Rolled by 0.3 rad: cos^2 * 0.01 + sin^2 * 0.003.
  MoveTo({Eigen::Quaterniond(Eigen::AngleAxisd(0.3, Eigen::Vector3d::UnitX())), {0, 0, 0}});
  const double want = std::pow(std::cos(0.3), 2) * 0.01 + std::pow(std::sin(0.3), 2) * 0.003;
  EXPECT_NEAR(CellOfMap(*Commit(), {0, 0}).variance_m2, want, 1e-7);
}

TEST_F(OneSession, TheLocalMapLiesOnTop) {
  Tell({.finished = {SquareAt(1, 0, 0, 1, 50)},
        .local_map = MakeLocalMap({10, 0}, 20, 5, 20 * kSecond_ns)});
  const auto snapshot = Commit();
  EXPECT_EQ(CellOfMap(*snapshot, {9, 3}).elevation_m, 1);
  EXPECT_EQ(CellOfMap(*snapshot, {10, 3}).elevation_m, 5) << "replaced, not fused";
  EXPECT_EQ(CellOfMap(*snapshot, {29, 3}).elevation_m, 5);
  // The robot drives on: what lay below comes to light again.
  Tell({.local_map = MakeLocalMap({100, 0}, 20, 5, 21 * kSecond_ns)});
  EXPECT_EQ(CellOfMap(*Commit(), {10, 3}).elevation_m, 1);
}

TEST_F(OneSession, TheLocalMapMovesWithTheCorrection) {
  Tell({.local_map = MakeLocalMap({0, 0}, 10, 5, 20 * kSecond_ns)});
  Commit();
  MoveTo(Pose<Global, Odom>::FromTranslation(200 * kCell_m, 0, 1));
  const auto snapshot = Commit();
  EXPECT_FALSE(CellOfMap(*snapshot, {0, 0}).known());
  EXPECT_EQ(CellOfMap(*snapshot, {200, 0}).elevation_m, 6);
  EXPECT_EQ(NumKnown(*snapshot), 100u);
}

TEST_F(OneSession, WhenASessionEndsItsSubmapsStayAndCanBeCorrected) {
  Tell({.finished = {SquareAt(1, 0, 0, 1)},
        .active = SquareAt(2, 100, 0, 1),
        .local_map = MakeLocalMap({0, 100}, 20, 5, 20 * kSecond_ns)});
  Commit();
  Tell({.finished = {SquareAt(2, 100, 0, 1)}, .ended = true});
  auto snapshot = Commit();
  EXPECT_EQ(NumKnown(*snapshot), 800u);
  EXPECT_TRUE(snapshot->sessions[0].ended);
  EXPECT_EQ(mapper_.Update("s", {}).code(), absl::StatusCode::kFailedPrecondition);
  MoveTo(Pose<Global, Odom>::FromTranslation(0, 0, 1));
  snapshot = Commit();
  EXPECT_EQ(CellOfMap(*snapshot, {0, 0}).elevation_m, 2);
  EXPECT_EQ(mapper_.Correct("s", {{101 * kSecond_ns, {}}}).status().code(),
            absl::StatusCode::kOutOfRange)
      << "odometry will never get there";
}

TEST_F(OneSession, StampsAheadMoveTheMapWhenOdometryGetsThere) {
  Finish(SquareAt(100, 0, 0, 1));
  Commit();
  const auto counts =
      mapper_.Correct("s", {{90 * kSecond_ns, Pose<Global, Base>::FromTranslation(90, 0, 1)},
                            {110 * kSecond_ns, Pose<Global, Base>::FromTranslation(110, 0, 3)}});
  EXPECT_EQ(counts->num_used, 1u);
  EXPECT_EQ(counts->num_ahead, 1u);
  EXPECT_NEAR(CellOfMap(*Commit(), {0, 0}).elevation_m, 2, 1e-6) << "rigidly by the nearest";
  Tell({.odometry = Odometry(101, 110)});
  EXPECT_NEAR(CellOfMap(*Commit(), {0, 0}).elevation_m, 3, 1e-6) << "between 1 and 3, plus 1";
}

TEST_F(OneSession, BadCorrectionsAreRefusedByNameAndChangeNothing) {
  Finish(SquareAt(1, 0, 0, 1));
  const auto before = Commit();
  EXPECT_EQ(mapper_.Correct("x", Moved({}, 0, 1)).status().code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(mapper_.Correct("s", {}).status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(mapper_.Correct("s", {{5, {}}, {5, {}}}).status().message(),
            "correction.poses[1].stamp_ns is 5, want more than 5");
  EXPECT_EQ(mapper_.Correct("s", {{-5, {}}}).status().code(), absl::StatusCode::kOutOfRange);
  EXPECT_EQ(Commit(), before);
}

TEST_F(OneSession, BadUpdatesAreRefusedWhole) {
  EXPECT_EQ(mapper_.Update("x", {}).code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(mapper_.AddSession("s", "r", {}).code(), absl::StatusCode::kAlreadyExists);
  EXPECT_EQ(
      mapper_.Update("s", {.odometry = Odometry(100, 101), .finished = {SquareAt(1, 0, 0, 1)}})
          .code(),
      absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(mapper_.Update("s", {.finished = {SquareAt(1, 0, 0, 1, 0, "other")}}).code(),
            absl::StatusCode::kInvalidArgument);
  LocalMap coarse = *MakeLocalMap({0, 0}, 10, 1, 1);
  coarse.cell_size_m = 0.4f;
  EXPECT_EQ(mapper_.Update("s", {.local_map = std::make_shared<const LocalMap>(std::move(coarse))})
                .code(),
            absl::StatusCode::kInvalidArgument);
  EXPECT_TRUE(Commit()->tiles.empty());
}

TEST_F(OneSession, ACancelledCommitPublishesNothingAndLosesNothing) {
  Finish(SquareAt(1, 0, 0, 1));
  const auto before = Commit();
  Finish(SquareAt(2, 100, 0, 1));
  MoveTo(Pose<Global, Odom>::FromTranslation(300 * kCell_m, 0, 0));
  CancelToken stop;
  stop.Cancel();
  EXPECT_EQ(mapper_.Commit(stop, report_), before);
  EXPECT_TRUE(report_.cancelled);
  // A newer correction arrives; old places and new submaps must not be forgotten.
  MoveTo(Pose<Global, Odom>::FromTranslation(0, 300 * kCell_m, 0));
  const auto snapshot = Commit();
  EXPECT_FALSE(report_.cancelled);
  EXPECT_FALSE(CellOfMap(*snapshot, {0, 0}).known());
  EXPECT_FALSE(CellOfMap(*snapshot, {300, 0}).known());
  EXPECT_TRUE(CellOfMap(*snapshot, {0, 300}).known());
  EXPECT_TRUE(CellOfMap(*snapshot, {100, 300}).known());
  EXPECT_EQ(NumKnown(*snapshot), 800u);
  EXPECT_EQ(snapshot->version.revision, 2u);
}

/// Commits until one is not cancelled, while another thread cancels at arbitrary moments.
std::shared_ptr<const MapSnapshot> CommitUnderFire(GlobalMapper& mapper, int& num_cancelled,
                                                   unsigned moment) {
  for (int attempt = 0;; ++attempt) {
    CancelToken cancel;
    std::atomic<bool> started{false};
    std::thread gunner([&] {
      while (!started) std::this_thread::yield();
      for (unsigned i = 0; i < moment * 2000; ++i)
        std::atomic_signal_fence(std::memory_order_seq_cst);
      cancel.Cancel();
    });
    CommitReport report;
    started = true;
    const auto old = mapper.snapshot();
    if (attempt == 8) {
      gunner.join();
      return mapper.Commit(CancelToken(), report);
    }
    const auto snapshot = mapper.Commit(cancel, report);
    gunner.join();
    if (!report.cancelled) return snapshot;
    EXPECT_EQ(snapshot, old);
    ++num_cancelled;
  }
}

TEST(Cancel, InMidCommitThenCommitIsAsIfNeverCancelled) {
  // Merging is on: a merge that a cancelled commit worked out must not stay.
  GlobalMapper under_fire(GlobalMapOptions{}, 1);
  GlobalMapper in_peace(GlobalMapOptions{}, 1);
  for (GlobalMapper* mapper : {&under_fire, &in_peace}) {
    ASSERT_TRUE(mapper->AddSession("s", "r", {}).ok());
    SessionUpdate update{.odometry = Odometry(0, 100)};
    for (int i = 0; i < 12; ++i)
      update.finished.push_back(MakeSubmap("s", i * 8 * kSecond_ns, AtCells(i * 60, 0),
                                           {{0, 0}, {80, 80}},
                                           Flat(0.01f * static_cast<float>(i))));
    ASSERT_TRUE(mapper->Update("s", std::move(update)).ok());
  }
  int num_cancelled = 0;
  for (unsigned round = 0; round < 25; ++round) {
    const Pose<Global, Odom> turn = Pose<Global, Odom>::FromYaw(0.01 * round, {1.0 * round, 0, 0});
    ASSERT_TRUE(under_fire.Correct("s", Moved(turn, 0, 100)).ok());
    ASSERT_TRUE(in_peace.Correct("s", Moved(turn, 0, 100)).ok());
    const auto a = CommitUnderFire(under_fire, num_cancelled, round);
    CommitReport report;
    const auto b = in_peace.Commit(CancelToken(), report);
    ASSERT_TRUE(SameCells(*a, *b)) << round;
    ASSERT_EQ(a->version, b->version);
    ASSERT_EQ(a->num_points, b->num_points);
  }
  EXPECT_GT(num_cancelled, 0);
}

TEST(Cancel, AMergeThatObsoletePosesSuggestDoesNotHappen) {
  // Two streets far apart. A wrong correction lays one on the other; before it is published, the
  // right one arrives.
  GlobalMapper mapper(GlobalMapOptions{}, 1);
  ASSERT_TRUE(mapper.AddSession("s", "r", {}).ok());
  ASSERT_TRUE(mapper
                  .Update("s", {.odometry = Odometry(0, 100),
                                .finished = {SquareAt(10, 0, 0, 0), SquareAt(60, 5000, 0, 0)}})
                  .ok());
  CommitReport report;
  mapper.Commit(CancelToken(), report);
  const auto lay_on_each_other = [&] {
    ASSERT_TRUE(mapper
                    .Correct("s", {{10 * kSecond_ns, Pose<Global, Base>::FromTranslation(10, 0, 0)},
                                   {60 * kSecond_ns, Pose<Global, Base>::FromTranslation(
                                                         60 - 5000 * kCell_m, 0, 0)}})
                    .ok());
  };
  for (unsigned moment = 0; moment < 200; ++moment) {
    lay_on_each_other();
    CancelToken cancel;
    std::atomic<bool> started{false};
    std::thread gunner([&] {
      while (!started) std::this_thread::yield();
      for (unsigned i = 0; i < moment * 200; ++i)
        std::atomic_signal_fence(std::memory_order_seq_cst);
      cancel.Cancel();
    });
    started = true;
    mapper.Commit(cancel, report);
    gunner.join();
    if (!report.cancelled) break;  // then it is published, and merged for good
    ASSERT_TRUE(mapper.Correct("s", Moved({}, 0, 100)).ok());
    ASSERT_EQ(mapper.Commit(CancelToken(), report)->num_points, 800u);
  }
}

TEST(TwoSessions, TheOrderOfArrivalDoesNotChangeTheMap) {
  const auto submap = [](const std::string& session, int i) {
    return MakeSubmap(
        session, i * 10 * kSecond_ns, AtCells(i * 12, session == "a" ? 0 : 6), {{0, 0}, {25, 25}},
        [i](CellIndex c) { return 0.1f * static_cast<float>((c.x + c.y * 3 + i) % 5); });
  };
  const auto build = [&](const std::vector<std::pair<std::string, int>>& arrivals) {
    GlobalMapper mapper(NoMerge(), 1);
    CommitReport report;
    for (const std::string& session :
         std::vector<std::string>{arrivals.front().first, arrivals.back().first}) {
      EXPECT_TRUE(mapper.AddSession(session, session, {}).ok());
      EXPECT_TRUE(mapper.Update(session, {.odometry = Odometry(0, 100)}).ok());
    }
    for (const auto& [session, i] : arrivals) {
      EXPECT_TRUE(mapper.Update(session, {.finished = {submap(session, i)}}).ok());
      mapper.Commit(CancelToken(), report);
    }
    return mapper.snapshot();
  };
  const auto one = build({{"a", 0}, {"a", 1}, {"b", 0}, {"a", 2}, {"b", 1}, {"b", 2}});
  const auto other = build({{"b", 0}, {"b", 1}, {"b", 2}, {"a", 0}, {"a", 1}, {"a", 2}});
  EXPECT_TRUE(SameCells(*one, *other));
  EXPECT_GT(NumKnown(*one), 1000u);
}

TEST(TwoSessions, OfSeveralLocalMapsTheNewestObservationWins) {
  GlobalMapper mapper(NoMerge(), 1);
  CommitReport report;
  for (const std::string& session : std::vector<std::string>{"b", "a"})
    ASSERT_TRUE(mapper.AddSession(session, "r", {}).ok());
  ASSERT_TRUE(mapper.Update("a", {.local_map = MakeLocalMap({0, 0}, 20, 1, 10)}).ok());
  ASSERT_TRUE(mapper.Update("b", {.local_map = MakeLocalMap({10, 0}, 20, 2, 11)}).ok());
  EXPECT_EQ(CellOfMap(*mapper.Commit(CancelToken(), report), {15, 5}).elevation_m, 2);
  ASSERT_TRUE(mapper.Update("a", {.local_map = MakeLocalMap({0, 0}, 20, 1, 11)}).ok());
  EXPECT_EQ(CellOfMap(*mapper.Commit(CancelToken(), report), {15, 5}).elevation_m, 1)
      << "a tie goes to the smaller id";
}

TEST(TwoSessions, ACorrectionMovesItsOwnSessionOnly) {
  GlobalMapper mapper(NoMerge(), 1);
  CommitReport report;
  for (const std::string& session : std::vector<std::string>{"a", "b"}) {
    ASSERT_TRUE(mapper.AddSession(session, session, {}).ok());
    ASSERT_TRUE(mapper
                    .Update(session,
                            {.odometry = Odometry(0, 9),
                             .finished = {SquareAt(1, session == "a" ? 0 : 300, 0, 1, 0, session)}})
                    .ok());
  }
  mapper.Commit(CancelToken(), report);
  ASSERT_TRUE(mapper.Correct("b", Moved(Pose<Global, Odom>::FromTranslation(0, 0, 1), 0, 9)).ok());
  const auto snapshot = mapper.Commit(CancelToken(), report);
  EXPECT_EQ(report.num_moved_submaps, 1u);
  EXPECT_EQ(CellOfMap(*snapshot, {0, 0}).elevation_m, 1);
  EXPECT_EQ(CellOfMap(*snapshot, {300, 0}).elevation_m, 2);
}

TEST(TwoSessions, TheirSubmapsMergeAlike) {
  GlobalMapper mapper(GlobalMapOptions{}, 1);
  CommitReport report;
  for (const std::string& session : std::vector<std::string>{"a", "b"}) {
    ASSERT_TRUE(mapper.AddSession(session, "robot-" + session, {}).ok());
    ASSERT_TRUE(
        mapper
            .Update(session, {.odometry = Odometry(0, 9),
                              .finished = {SquareAt(session == "a" ? 1 : 2, 0, 0, 1, 0, session)}})
            .ok());
  }
  const auto snapshot = mapper.Commit(CancelToken(), report);
  EXPECT_EQ(report.num_merged_submaps, 1u);
  ASSERT_EQ(snapshot->submaps.size(), 1u);
  EXPECT_EQ(snapshot->submaps[0].contributors,
            (ContributorSet{{"a", "robot-a"}, {"b", "robot-b"}}));
  EXPECT_EQ(snapshot->num_points, 400u);
}

TEST(Looping, StorageStaysFlatOverTwentyLoops) {
  GlobalMapper mapper(GlobalMapOptions{}, 1);
  CommitReport report;
  ASSERT_TRUE(mapper.AddSession("s", "r", {}).ok());
  // A loop of eight submaps along a square street, 100 s a lap; the laps are not in phase.
  std::vector<std::uint64_t> points, bytes;
  std::vector<std::size_t> submaps;
  std::int64_t stamp_s = 0;
  for (int lap = 0; lap < 20; ++lap) {
    for (int k = 0; k < 8; ++k) {
      stamp_s += 12;
      const int along = (k * 100 + (lap % 3) * 17) % 800;
      const int side = along / 200, on = along % 200;
      const CellIndex at = side == 0   ? CellIndex{on, 0}
                           : side == 1 ? CellIndex{200, on}
                           : side == 2 ? CellIndex{200 - on, 200}
                                       : CellIndex{0, 200 - on};
      SessionUpdate update;
      update.odometry = {{stamp_s * kSecond_ns, BaseAt(at.x * kCell_m, at.y * kCell_m)}};
      update.finished = {MakeSubmap("s", stamp_s * kSecond_ns, AtCells(at.x, at.y),
                                    {{-40, -40}, {40, 40}}, Flat(0))};
      ASSERT_TRUE(mapper.Update("s", std::move(update)).ok());
      mapper.Commit(CancelToken(), report);
    }
    points.push_back(mapper.snapshot()->num_points);
    bytes.push_back(mapper.snapshot()->submap_bytes);
    submaps.push_back(mapper.snapshot()->submaps.size());
  }
  EXPECT_LE(points.back(), points[3]) << "flat once every phase was driven";
  EXPECT_LE(bytes.back(), bytes[3] + bytes[3] / 100);
  EXPECT_LE(submaps.back(), 8u);
  EXPECT_LE(points[3], points[0] * 2);
}

TEST(Looping, AnIdenticalRevisitKeepsTheNumberOfPoints) {
  GlobalMapper mapper(GlobalMapOptions{}, 1);
  CommitReport report;
  ASSERT_TRUE(mapper.AddSession("s", "r", {}).ok());
  for (int lap = 1; lap <= 20; ++lap) {
    SessionUpdate update{.odometry = {{lap * 400 * kSecond_ns, BaseAt(0)}}};
    update.finished = {SquareAt(lap * 400, 0, 0, 1)};
    ASSERT_TRUE(mapper.Update("s", std::move(update)).ok());
    mapper.Commit(CancelToken(), report);
    ASSERT_EQ(mapper.snapshot()->num_points, 400u) << lap;
    ASSERT_EQ(mapper.snapshot()->submaps.size(), 1u);
    ASSERT_EQ(mapper.snapshot()->submaps[0].origin.id, SubmapId{1}) << "the oldest one stays";
  }
}

}  // namespace
}  // namespace gem
