// Random histories with fixed seeds: however a map came to its state, by many commits or by one, it
// must look the same.
#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <random>

#include "core/global/global_mapper.h"
#include "scenes.h"

namespace gem {
namespace {

using test::kSecond_ns;

class History {
 public:
  explicit History(unsigned seed) : random_(seed) {}

  void Step(GlobalMapper& mapper) {
    const std::string session = Uniform(0, 1) < 0.5 ? "a" : "b";
    Robot& robot = robots_[session];
    if (!robot.added) {
      robot.added = true;
      robot.T_G_O = RandomMove(0.2);
      ASSERT_TRUE(mapper.AddSession(session, session, robot.T_G_O).ok());
    }
    if (Uniform(0, 1) < 0.1) {
      robot.retracted = !robot.retracted;
      ASSERT_TRUE(mapper.Retract(session, !robot.retracted).ok());
    } else if (!robot.ended && Uniform(0, 1) < 0.7) {
      ASSERT_TRUE(mapper.Update(session, Drive(session, robot)).ok());
    } else if (!robot.odometry.empty()) {
      robot.correction = RandomCorrection(robot);
      ASSERT_TRUE(mapper.Correct(session, robot.correction).ok());
    }
  }

  /// All at once: what the last state is made of.
  std::shared_ptr<const MapSnapshot> Afresh(const GlobalMapOptions& options) {
    GlobalMapper mapper(options, 1);
    for (auto& [session, robot] : robots_) {
      EXPECT_TRUE(mapper.AddSession(session, session, robot.T_G_O).ok());
      if (robot.ended) robot.last.active = nullptr;
      EXPECT_TRUE(mapper
                      .Update(session, {.odometry = robot.odometry,
                                        .finished = robot.finished,
                                        .active = robot.last.active,
                                        .local_map = robot.last.local_map,
                                        .ended = robot.ended})
                      .ok());
      if (!robot.correction.empty()) {
        EXPECT_TRUE(mapper.Correct(session, robot.correction).ok());
      }
      if (robot.retracted) {
        EXPECT_TRUE(mapper.Retract(session, false).ok());
      }
    }
    CommitReport report;
    return mapper.Commit(CancelToken(), report);
  }

  CorrectedTrajectory CorrectionOf(const std::string& session) {
    return RandomCorrection(robots_.at(session));
  }
  bool everybody_is_retracted() const {
    return std::all_of(robots_.begin(), robots_.end(),
                       [](const auto& each) { return each.second.retracted; });
  }
  std::vector<std::string> sessions() const {
    std::vector<std::string> names;
    for (const auto& [session, robot] : robots_) names.push_back(session);
    return names;
  }

 private:
  struct Robot {
    Pose<Global, Odom> T_G_O;
    std::int64_t stamp_s = 0;
    std::vector<StampedPose<Odom, Base>> odometry;
    std::vector<std::shared_ptr<const Submap>> finished;
    SessionUpdate last;
    CorrectedTrajectory correction;
    std::int64_t anchor_s = 1;
    std::int32_t width = 10;
    bool added = false;
    bool ended = false;
    bool retracted = false;
  };

  double Uniform(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random_);
  }

  Pose<Global, Odom> RandomMove(double size) {
    const Eigen::Vector3d axis(Uniform(-0.2, 0.2), Uniform(-0.2, 0.2), 1);
    return {Eigen::Quaterniond(Eigen::AngleAxisd(size * Uniform(-3, 3), axis.normalized())),
            Eigen::Vector3d(size * Uniform(-40, 40), size * Uniform(-40, 40), Uniform(-1, 1))};
  }

  SessionUpdate Drive(const std::string& session, Robot& robot) {
    SessionUpdate update;
    for (int i = 0; i < 3; ++i) {
      ++robot.stamp_s;
      const double s = static_cast<double>(robot.stamp_s);
      update.odometry.push_back({robot.stamp_s * kSecond_ns,
                                 Pose<Odom, Base>::FromYaw(0.1 * s, {s, 3 * std::sin(s), 0})});
    }
    const auto submap = [&](std::int64_t anchor_s, std::int32_t width) {
      return test::MakeSubmap(
          session, anchor_s * kSecond_ns, test::AtCells(static_cast<std::int32_t>(anchor_s) * 5, 0),
          {{-width, -8}, {width, 12}},
          [=](CellIndex c) { return 0.3f * static_cast<float>((c.x * c.y + anchor_s) % 4); });
    };
    robot.width += 4;
    if (robot.width > 40) {
      update.finished = {submap(robot.anchor_s, robot.width)};
      robot.anchor_s = robot.stamp_s;
      robot.width = 10;
    }
    robot.ended = robot.stamp_s > 120;
    if (!robot.ended) {
      if (Uniform(0, 1) < 0.9) update.active = submap(robot.anchor_s, robot.width);
      if (Uniform(0, 1) < 0.9)
        update.local_map = test::MakeLocalMap({static_cast<std::int32_t>(robot.stamp_s) * 5, -10},
                                              20, 0.5f, robot.stamp_s * kSecond_ns);
    }
    update.ended = robot.ended;
    robot.odometry.insert(robot.odometry.end(), update.odometry.begin(), update.odometry.end());
    robot.finished.insert(robot.finished.end(), update.finished.begin(), update.finished.end());
    robot.last = update;
    return update;
  }

  /// Some stamps between odometry's, some ahead; at least one that can be used at once.
  CorrectedTrajectory RandomCorrection(const Robot& robot) {
    const Pose<Global, Odom> move = RandomMove(1);
    CorrectedTrajectory correction;
    correction.push_back({robot.odometry.front().stamp_ns, move * robot.odometry.front().T_A_B});
    std::int64_t stamp_ns = correction.front().stamp_ns;
    for (int i = 0; i < 5; ++i) {
      stamp_ns += static_cast<std::int64_t>(Uniform(1, 20e9));
      const double s = static_cast<double>(stamp_ns) * 1e-9;
      correction.push_back({stamp_ns, move * Pose<Odom, Base>::FromYaw(0.1 * s + Uniform(0, 0.1),
                                                                       {s, Uniform(-3, 3), 0})});
    }
    return correction;
  }

  std::mt19937 random_;
  std::map<std::string, Robot> robots_;
};

class RandomHistory : public testing::TestWithParam<unsigned> {};

TEST_P(RandomHistory, ManyCommitsEqualOne) {
  GlobalMapOptions options;
  options.merge_overlap_min = 2;  // merging depends on when it happens
  GlobalMapper mapper(options, 1);
  History history(GetParam());
  std::mt19937 random(GetParam() + 1000);
  CommitReport report;
  for (int step = 0; step < 60; ++step) {
    history.Step(mapper);
    if (testing::Test::HasFatalFailure()) return;
    if (random() % 3 == 0) mapper.Commit(CancelToken(), report);
    if (random() % 5 == 0) {
      CancelToken cancel;
      cancel.Cancel();
      mapper.Commit(cancel, report);
    }
    if (step % 20 != 19) continue;
    const auto incremental = mapper.Commit(CancelToken(), report);
    const auto afresh = history.Afresh(options);
    ASSERT_TRUE(test::SameCells(*incremental, *afresh)) << "step " << step;
    ASSERT_EQ(incremental->num_points, afresh->num_points);
    ASSERT_TRUE(history.everybody_is_retracted() || test::NumKnown(*afresh) > 100u);
    for (const auto& [index, tile] : incremental->tiles)
      ASSERT_TRUE(std::any_of(tile->cells.begin(), tile->cells.end(),
                              [](const CellBelief& c) { return c.known(); }));
  }
}

// Whatever was merged with whatever: a retracted session leaves nothing, and all of it comes back.
TEST_P(RandomHistory, RetractionsAreCleanAndCanBeUndone) {
  GlobalMapper mapper(GlobalMapOptions{}, 1);
  History history(GetParam());
  CommitReport report;
  for (int step = 0; step < 60; ++step) {
    history.Step(mapper);
    if (testing::Test::HasFatalFailure()) return;
    mapper.Commit(CancelToken(), report);
  }
  const std::vector<std::string> sessions = history.sessions();
  for (const std::string& session : sessions) ASSERT_TRUE(mapper.Retract(session, true).ok());
  const auto whole = mapper.Commit(CancelToken(), report);
  for (const std::string& out : sessions) {
    ASSERT_TRUE(mapper.Retract(out, false).ok());
    const auto without = mapper.Commit(CancelToken(), report);
    for (const SubmapInfo& submap : without->submaps)
      for (const Contributor& each : submap.contributors) ASSERT_NE(each.session, out);
    ASSERT_LT(without->num_points, whole->num_points);
    ASSERT_TRUE(mapper.Retract(out, true).ok());
    ASSERT_TRUE(test::SameCells(*mapper.Commit(CancelToken(), report), *whole)) << out;
  }
}

// What was merged, hidden, corrected or still growing: the map of its state looks the same, and
// goes on to look the same whatever is done to both.
TEST_P(RandomHistory, AMapIsTheSameAsThatOfItsState) {
  GlobalMapper mapper(GlobalMapOptions{}, 1);
  History history(GetParam());
  CommitReport report;
  for (int step = 0; step < 60; ++step) {
    history.Step(mapper);
    if (testing::Test::HasFatalFailure()) return;
    mapper.Commit(CancelToken(), report);
  }
  auto loaded = GlobalMapper::FromState(mapper.State(), 2, 10'000);
  ASSERT_TRUE(loaded.ok()) << loaded.status();
  GlobalMapper& copy = **loaded;
  const auto compare = [&](const std::string& after) {
    const auto a = mapper.Commit(CancelToken(), report);
    const auto b = copy.Commit(CancelToken(), report);
    EXPECT_TRUE(test::SameLevels(*a, *b)) << after;
    EXPECT_EQ(a->num_points, b->num_points) << after;
    EXPECT_EQ(a->submaps.size(), b->submaps.size()) << after;
    EXPECT_TRUE(b->sessions.empty() || b->sessions.front().ended);
  };
  compare("loading");
  EXPECT_EQ(copy.snapshot()->version, (MapVersion{2, 1}));
  for (const std::string& session : history.sessions()) {
    const bool retracted = GetParam() % 2 == 0;
    ASSERT_TRUE(mapper.Retract(session, retracted).ok() && copy.Retract(session, retracted).ok());
    compare("retracting or restoring " + session);
    const CorrectedTrajectory correction = history.CorrectionOf(session);
    ASSERT_TRUE(mapper.Correct(session, correction).ok() && copy.Correct(session, correction).ok());
    compare("correcting " + session);
    ASSERT_TRUE(mapper.Retract(session, !retracted).ok() && copy.Retract(session, !retracted).ok());
    compare("the other of the two " + session);
  }
}

// Maintenance looked at it before it was written down: a second look would change cells.
TEST(MapOfAState, IsNotMaintainedBeforeItIsPublished) {
  GlobalMapOptions options;
  options.merge_overlap_min = 2;
  GlobalMapper mapper(options, 1);
  ASSERT_TRUE(mapper.AddSession("s", "r", {}).ok());
  for (const std::int64_t stamp_ns : {1, 2}) {
    const auto square =
        test::MakeSubmap("s", stamp_ns, test::AtCells(0, 0), {{0, 0}, {9, 9}}, test::Flat(1));
    ASSERT_TRUE(mapper.Update("s", {.odometry = {{stamp_ns, {}}}, .finished = {square}}).ok());
  }
  CommitReport report;
  mapper.Commit(CancelToken(), report);
  MapState state = mapper.State();
  state.options.merge_overlap_min = 0.5f;
  auto loaded = GlobalMapper::FromState(state, 2, 100);
  ASSERT_TRUE(loaded.ok());
  EXPECT_EQ((*loaded)->Commit(CancelToken(), report)->submaps.size(), 2u);
  ASSERT_TRUE((*loaded)->Correct("s", {{1, Pose<Global, Base>::FromTranslation(1, 0, 0)}}).ok());
  EXPECT_EQ((*loaded)->Commit(CancelToken(), report)->submaps.size(), 1u);
}

TEST(MapOfAState, IsRefusedIfItLiesOnTooManyTiles) {
  GlobalMapper mapper(GlobalMapOptions{}, 1);
  ASSERT_TRUE(mapper.AddSession("s", "r", {}).ok());
  ASSERT_TRUE(mapper.Update("s", {.local_map = test::MakeLocalMap({-10, 0}, 20, 1, 1)}).ok());
  CommitReport report;
  mapper.Commit(CancelToken(), report);
  EXPECT_TRUE(GlobalMapper::FromState(mapper.State(), 2, 2).ok());
  EXPECT_EQ(GlobalMapper::FromState(mapper.State(), 2, 1).status().message(),
            "the map lies on more tiles than 1, want at most so many");
}

INSTANTIATE_TEST_SUITE_P(Seeds, RandomHistory, testing::Range(0u, 12u));

TEST(RandomHistory, TheComparisonCanFail) {
  const auto map = [](float elevation_m) {
    GlobalMapper mapper(GlobalMapOptions{}, 1);
    EXPECT_TRUE(mapper.AddSession("s", "r", {}).ok());
    EXPECT_TRUE(
        mapper.Update("s", {.local_map = test::MakeLocalMap({0, 0}, 9, elevation_m, 1)}).ok());
    CommitReport report;
    return mapper.Commit(CancelToken(), report);
  };
  EXPECT_TRUE(test::SameCells(*map(1), *map(1)));
  EXPECT_FALSE(test::SameCells(*map(1), *map(1.0001f)));
}

}  // namespace
}  // namespace gem
