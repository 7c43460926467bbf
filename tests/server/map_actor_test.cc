#include "server/map_actor.h"

#include <gtest/gtest.h>

#include <future>
#include <optional>
#include <thread>

#include "proto/wire/refusal.h"
#include "tests/core/global/scenes.h"

namespace gem {
namespace {

constexpr std::uint64_t kEpoch = 7;

/// A submap of one cell at the origin of K, which lies at (x, 0, 0) of O.
std::shared_ptr<const Submap> OneCellSubmap(double x_m, std::int64_t stamp_ns) {
  SubmapOrigin origin;
  origin.session = "s";
  origin.robot = "r";
  origin.anchor_stamp_ns = stamp_ns;
  origin.T_O_K = Pose<Odom, Submap>::FromTranslation(x_m, 0, 0);
  origin.cell_size_m = 1;
  SubmapCell cell;
  cell.covariance_m2 = {0.01f, 0, 0, 0.01f, 0, 0.01f};
  cell.traversability = 1;
  cell.stamp_ns = stamp_ns;
  cell.state = kCellKnown | kCellAnnotated;
  return std::make_shared<Submap>(origin, std::vector<KeyedSubmapCell>{{{0, 0}, cell}});
}

/// The robot is at (x, 0, 0) at the stamp and finishes a submap there.
SessionUpdate UpdateAt(double x_m, std::int64_t stamp_ns) {
  SessionUpdate update;
  update.odometry.push_back({stamp_ns, Pose<Odom, Base>::FromTranslation(x_m, 0, 0)});
  update.finished.push_back(OneCellSubmap(x_m, stamp_ns));
  return update;
}

class MapActorTest : public testing::Test {
 protected:
  explicit MapActorTest(MapActorOptions limits = {}) {
    options_.cell_size_m = 1;
    map_ = std::make_unique<MapActor>("m", options_, kEpoch, limits, metrics_);
    EXPECT_TRUE(map_->AddSession("s", "r", {}).ok());
  }

  /// Ends the session with `update` and waits for the publication.
  absl::StatusOr<MapVersion> End(SessionUpdate update) {
    update.ended = true;
    std::promise<absl::StatusOr<MapVersion>> promise;
    map_->Update("s", std::move(update),
                 [&](const absl::StatusOr<MapVersion>& version) { promise.set_value(version); });
    return promise.get_future().get();
  }

  absl::StatusOr<CorrectionAnswer> Correct(double raise_m, std::int64_t stamp_ns,
                                           const std::string& request_id = "") {
    std::promise<absl::StatusOr<CorrectionAnswer>> promise;
    map_->Correct(
        "s", request_id, {{stamp_ns, Pose<Global, Base>::FromTranslation(0, 0, raise_m)}},
        [&](const absl::StatusOr<CorrectionAnswer>& answer) { promise.set_value(answer); });
    return promise.get_future().get();
  }

  absl::StatusOr<RetractionAnswer> Retract(const std::string& request_id, bool restore) {
    std::promise<absl::StatusOr<RetractionAnswer>> promise;
    map_->Retract("s", request_id, restore, [&](const absl::StatusOr<RetractionAnswer>& answer) {
      promise.set_value(answer);
    });
    return promise.get_future().get();
  }

  float HeightAt(CellIndex cell) const {
    const auto snapshot = map_->snapshot();
    const auto tile = snapshot->tiles.find(TileOf(cell));
    if (tile == snapshot->tiles.end()) return -999;
    const CellBelief& belief = tile->second->cells[static_cast<std::size_t>(IndexInTile(cell))];
    return belief.known() ? belief.elevation_m : -999;
  }

  GlobalMapOptions options_;
  Metrics metrics_;
  std::unique_ptr<MapActor> map_;
};

TEST_F(MapActorTest, PublishesAtOnceWhenASessionEnds) {
  const auto version = End(UpdateAt(0, 100));
  ASSERT_TRUE(version.ok()) << version.status();
  EXPECT_EQ(version->epoch, kEpoch);
  EXPECT_EQ(map_->snapshot()->version, *version);
  EXPECT_EQ(HeightAt({0, 0}), 0);
}

TEST_F(MapActorTest, KeepsEveryFinishedSubmapOfUpdatesThatWaitedTogether) {
  for (int i = 0; i < 10; ++i) map_->Update("s", UpdateAt(10 * i, 100 + i), nullptr);
  ASSERT_TRUE(End(UpdateAt(100, 200)).ok());
  EXPECT_EQ(map_->snapshot()->submaps.size(), 11u);
}

TEST_F(MapActorTest, AnswersACorrectionWithTheVersionThatShowsIt) {
  ASSERT_TRUE(End(UpdateAt(0, 100)).ok());
  const auto answer = Correct(2, 100);
  ASSERT_TRUE(answer.ok()) << answer.status();
  EXPECT_EQ(answer->num_moved_submaps, 1u);
  EXPECT_EQ(map_->snapshot()->version, answer->version);
  EXPECT_NEAR(HeightAt({0, 0}), 2, 1e-6);
}

TEST_F(MapActorTest, RemembersAnswersByRequestIdAndForgetsErrors) {
  ASSERT_TRUE(End(UpdateAt(0, 100)).ok());
  EXPECT_EQ(Correct(1, 1, "a").status().code(), absl::StatusCode::kOutOfRange);
  const auto first = Correct(1, 100, "a");
  ASSERT_TRUE(first.ok()) << first.status();
  ASSERT_TRUE(Correct(2, 100, "b").ok());
  const auto again = Correct(1, 100, "a");
  ASSERT_TRUE(again.ok());
  EXPECT_EQ(again->version, first->version);
  EXPECT_NEAR(HeightAt({0, 0}), 2, 1e-6);
}

TEST_F(MapActorTest, RefusesSessionsItKnowsAndCorrectionsOfThoseItDoesNot) {
  EXPECT_EQ(map_->AddSession("s", "r", {}).code(), absl::StatusCode::kAlreadyExists);
  absl::Status status;
  map_->Correct("x", "", {{1, {}}},
                [&](const absl::StatusOr<CorrectionAnswer>& answer) { status = answer.status(); });
  EXPECT_EQ(status.code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(wire::FieldOf(status), "session");
}

// Finishing, merging and rendering happen on the map's thread with no lock held: whoever reads, or
// feeds the map, must not wait for it. Here the thread stands still in the middle of its work.
TEST_F(MapActorTest, NobodyWaitsForItsThread) {
  std::promise<void> published, go_on;
  SessionUpdate first = UpdateAt(0, 100);
  map_->Update("s", std::move(first), [&](const absl::StatusOr<MapVersion>&) {
    published.set_value();
    go_on.get_future().wait();
  });
  published.get_future().wait();
  const MapVersion version = map_->snapshot()->version;
  for (int i = 1; i <= 10; ++i) map_->Update("s", UpdateAt(10 * i, 100 + i), nullptr);
  std::promise<void> corrected;
  map_->Correct("s", "", {{100, Pose<Global, Base>::FromTranslation(0, 0, 1)}},
                [&](const absl::StatusOr<CorrectionAnswer>&) { corrected.set_value(); });
  EXPECT_EQ(map_->snapshot()->version, version);
  EXPECT_EQ(map_->lag().num_corrections, 1);
  EXPECT_EQ(map_->NewestSessions(10).sessions.size(), 1u);
  go_on.set_value();
  corrected.get_future().wait();
  EXPECT_EQ(map_->snapshot()->submaps.size(), 11u);
}

// Whatever renderings were stopped and restarted on the way.
TEST_F(MapActorTest, TheLastMapIsTheOneOfTheLastCorrectionAlone) {
  constexpr int kRounds = 50;
  constexpr std::int64_t kRound_ns = 10;
  const auto trajectory = [](int round) {
    const double turned_rad = 0.01 * round;
    return CorrectedTrajectory{
        {kRound_ns, Pose<Global, Base>::FromYaw(turned_rad, {0, 0, 1})},
        {round * kRound_ns,
         Pose<Global, Base>::FromYaw(turned_rad, {10.0 * round, 0.5 * round, 2})}};
  };
  GlobalMapper alone(options_, kEpoch);
  ASSERT_TRUE(alone.AddSession("s", "r", {}).ok());
  for (int round = 1; round <= kRounds; ++round) {
    map_->Update("s", UpdateAt(10 * round, round * kRound_ns), nullptr);
    ASSERT_TRUE(alone.Update("s", UpdateAt(10 * round, round * kRound_ns)).ok());
    if (round == 1 || round == kRounds) continue;
    // Nobody waits for the answer, so that some overtake others.
    map_->Correct("s", "", trajectory(round), [](const absl::StatusOr<CorrectionAnswer>&) {});
  }
  std::promise<absl::StatusOr<CorrectionAnswer>> last;
  map_->Correct("s", "", trajectory(kRounds),
                [&](const absl::StatusOr<CorrectionAnswer>& answer) { last.set_value(answer); });
  ASSERT_TRUE(last.get_future().get().ok());
  ASSERT_TRUE(alone.Correct("s", trajectory(kRounds)).ok());
  CommitReport report;
  const auto want = alone.Commit(CancelToken(), report);
  EXPECT_GT(test::NumKnown(*want), 40u);  // a turned cell may hold no centre of a cell of G
  EXPECT_TRUE(test::SameCells(*map_->snapshot(), *want));
}

TEST_F(MapActorTest, TellsWhoWaitsThatItStops) {
  map_->Stop();
  EXPECT_EQ(Correct(1, 100).status().code(), absl::StatusCode::kUnavailable);
  EXPECT_EQ(Retract("", false).status().code(), absl::StatusCode::kUnavailable);
  EXPECT_EQ(End(UpdateAt(0, 100)).status().code(), absl::StatusCode::kUnavailable);
}

TEST_F(MapActorTest, AnswersARetractionWithTheVersionThatShowsItAndRemembersIt) {
  ASSERT_TRUE(End(UpdateAt(0, 100)).ok());
  const auto first = Retract("a", false);
  ASSERT_TRUE(first.ok()) << first.status();
  EXPECT_EQ(first->counts.num_submaps, 1u);
  EXPECT_EQ(first->num_touched_tiles, 1u);
  EXPECT_EQ(map_->snapshot()->version, first->version);
  EXPECT_TRUE(map_->snapshot()->tiles.empty());

  ASSERT_TRUE(Retract("b", true).ok());
  EXPECT_EQ(HeightAt({0, 0}), 0);
  const auto again = Retract("a", false);
  ASSERT_TRUE(again.ok());
  EXPECT_EQ(again->version, first->version) << "the earlier answer";
  EXPECT_EQ(HeightAt({0, 0}), 0) << "and nothing happens";
}

TEST_F(MapActorTest, ARetractionOfASessionThatItDoesNotKnowNamesTheField) {
  absl::Status status;
  map_->Retract("x", "", false,
                [&](const absl::StatusOr<RetractionAnswer>& answer) { status = answer.status(); });
  EXPECT_EQ(status.code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(wire::FieldOf(status), "session");
}

class NarrowMapActorTest : public MapActorTest {
 protected:
  NarrowMapActorTest()
      : MapActorTest({.publish_hz = 0.001, .sessions_max = 1, .finished_submaps_waiting_max = 2}) {}
};

TEST_F(NarrowMapActorTest, HasALimitOfSessions) {
  const absl::Status status = map_->AddSession("t", "r", {});
  EXPECT_EQ(status.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(std::string(status.message()), "map m has had 1 sessions, want at most 1");
}

TEST_F(NarrowMapActorTest, TakesFinishedSubmapsAtOnceWhenTooManyWait) {
  // Live data is published every 1000 s here: without urgency the third update would wait so long.
  for (int i = 0; i < 10; ++i) map_->Update("s", UpdateAt(10 * i, 100 + i), nullptr);
  ASSERT_TRUE(End({}).ok());
  EXPECT_EQ(map_->snapshot()->submaps.size(), 10u);
}

TEST(Coalesce, AddsUpWhatMustNotBeLostAndReplacesTheRest) {
  PendingSession pending;
  SessionUpdate first = UpdateAt(0, 100);
  first.active = OneCellSubmap(1, 101);
  first.local_map = std::make_shared<LocalMap>();
  Coalesce(pending, first);
  SessionUpdate second = UpdateAt(10, 200);
  Coalesce(pending, second);
  EXPECT_EQ(pending.update.odometry.size(), 2u);
  EXPECT_EQ(pending.update.finished.size(), 2u);
  EXPECT_EQ(pending.update.active, nullptr);
  EXPECT_EQ(pending.update.local_map, nullptr);
  EXPECT_FALSE(pending.update.ended);
}

TEST(AnswerMemory, ForgetsTheOldestFirst) {
  AnswerMemory<CorrectionAnswer> memory(2);
  for (std::uint64_t revision = 1; revision <= 3; ++revision) {
    CorrectionAnswer answer;
    answer.version.revision = revision;
    memory.Remember("s", std::to_string(revision), answer);
  }
  EXPECT_EQ(memory.Find("s", "1"), nullptr);
  ASSERT_NE(memory.Find("s", "2"), nullptr);
  EXPECT_EQ(memory.Find("s", "3")->version.revision, 3u);
  EXPECT_EQ(memory.Find("t", "3"), nullptr);
  memory.Remember("s", "", {});
  EXPECT_EQ(memory.Find("s", ""), nullptr);
}

class MapActorThatSeldomPublishes : public MapActorTest {
 protected:
  MapActorThatSeldomPublishes() : MapActorTest(Limits()) {}
  static MapActorOptions Limits() {
    MapActorOptions limits;
    limits.publish_hz = 0.001;
    return limits;
  }
};

TEST_F(MapActorThatSeldomPublishes, KnowsHowLongItsOldestNewsHasWaited) {
  // The session that was added is published at once, then nothing for a thousand seconds.
  while (map_->lag().oldest_waiting.has_value()) std::this_thread::yield();
  const Clock::time_point before = Clock::now();
  map_->Update("s", UpdateAt(0, 0), nullptr);
  const Clock::time_point between = Clock::now();
  map_->Update("s", UpdateAt(1, 1), nullptr);
  const std::optional<Clock::time_point> waiting = map_->lag().oldest_waiting;
  ASSERT_TRUE(waiting.has_value());
  EXPECT_GE(*waiting, before);
  EXPECT_LE(*waiting, between);
  // A correction does not wait, and takes along what does.
  const Clock::time_point corrected = Clock::now();
  ASSERT_TRUE(Correct(1, 0).ok());
  const MapActor::Lag lag = map_->lag();
  EXPECT_FALSE(lag.oldest_waiting.has_value());
  EXPECT_FALSE(lag.oldest_correction.has_value());
  EXPECT_EQ(lag.num_corrections, 0);
  EXPECT_GE(lag.published, corrected);
}

}  // namespace
}  // namespace gem
