// Maps that come and go while sessions, corrections and readers use them.
#include "server/registry.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "proto/wire/refusal.h"

namespace gem {
namespace {

constexpr std::uint64_t kEpoch = 100;

wire::SessionSetup SetupOf(const std::string& map, const std::string& robot,
                           const std::string& session) {
  wire::SessionSetup setup;
  setup.map = map;
  setup.robot = robot;
  setup.session = session;
  setup.sensors.push_back({"top", {}, {}});
  return setup;
}

/// A robot's stream that remembers how it ended.
class FakeStream : public IngestSink {
 public:
  void OnProgress() override {}
  void OnEnded(const absl::StatusOr<SessionEnd>& end) override {
    MutexLock lock(mutex_);
    end_ = end.status();
  }
  void OnTakenOver() override {}
  std::optional<absl::Status> end() const {
    MutexLock lock(mutex_);
    return end_;
  }

 private:
  mutable Mutex mutex_;
  std::optional<absl::Status> end_ ABSL_GUARDED_BY(mutex_);
};

class RegistryTest : public testing::Test {
 protected:
  static ServerOptions Options() {
    ServerOptions options;
    options.publish_hz = 100;
    options.local_map.side_m = 4;
    options.request_ids_max = 3;
    options.sessions_max = 1000;
    return options;
  }

  std::shared_ptr<SessionActor> Open(const std::string& map, const std::string& session,
                                     const std::shared_ptr<FakeStream>& stream = nullptr) {
    auto opened = registry_.OpenSession(SetupOf(map, "robot-" + session, session));
    EXPECT_TRUE(opened.ok()) << opened.status();
    if (!opened.ok()) return nullptr;
    EXPECT_TRUE(stream == nullptr || (*opened)->mailbox().Attach(stream).ok());
    return *opened;
  }

  Metrics metrics_;
  Registry registry_{Options(), kEpoch, metrics_};
};

TEST_F(RegistryTest, MakesAMapWithWhatTheSetupSays) {
  wire::MapSetup setup;
  setup.cell_size_m = 0.5f;
  setup.traversable_only = true;
  const auto map = registry_.CreateMap("m", setup, "");
  ASSERT_TRUE(map.ok()) << map.status();
  EXPECT_EQ((*map)->options().cell_size_m, 0.5f);
  EXPECT_EQ((*map)->options().submap_length_m, GlobalMapOptions().submap_length_m);
  EXPECT_TRUE((*map)->options().traversable_only);
  EXPECT_EQ(*registry_.FindMap("m"), *map);
  EXPECT_EQ((*map)->snapshot()->version, (MapVersion{kEpoch, 0}));
}

TEST_F(RegistryTest, ARequestThatIsRepeatedReturnsTheMapThatItMade) {
  const auto map = registry_.CreateMap("m", {}, "a");
  ASSERT_TRUE(map.ok());
  EXPECT_EQ(*registry_.CreateMap("m", {}, "a"), *map);
  const absl::Status other = registry_.CreateMap("m", {}, "b").status();
  EXPECT_EQ(other.code(), absl::StatusCode::kAlreadyExists);
  EXPECT_EQ(wire::FieldOf(other), "map");
  EXPECT_EQ(registry_.CreateMap("m", {}, "").status().code(), absl::StatusCode::kAlreadyExists);
  EXPECT_EQ(registry_.Maps().size(), 1u);
}

TEST_F(RegistryTest, ARepeatedRequestNeverBringsBackAMapThatWasDeleted) {
  ASSERT_TRUE(registry_.CreateMap("m", {}, "a").ok());
  ASSERT_TRUE(registry_.DeleteMap("m", "", false).ok());
  const absl::Status late = registry_.CreateMap("m", {}, "a").status();
  EXPECT_EQ(late.code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_EQ(wire::FieldOf(late), "request_id");
  // Nor does it return somebody else's map of the same id.
  ASSERT_TRUE(registry_.CreateMap("m", {}, "b").ok());
  EXPECT_EQ(registry_.CreateMap("m", {}, "a").status().code(),
            absl::StatusCode::kFailedPrecondition);
}

TEST_F(RegistryTest, ARepeatedDeletionLeavesTheNextMapAlone) {
  ASSERT_TRUE(registry_.CreateMap("m", {}, "").ok());
  ASSERT_TRUE(registry_.DeleteMap("m", "d", false).ok());
  ASSERT_TRUE(registry_.CreateMap("m", {}, "").ok());
  EXPECT_TRUE(registry_.DeleteMap("m", "d", true).ok());
  EXPECT_TRUE(registry_.FindMap("m").ok());
}

TEST_F(RegistryTest, RequestIdsAreForgottenOldestFirst) {
  for (const char* id : {"a", "b", "c", "d"})
    ASSERT_TRUE(registry_.CreateMap(std::string("m") + id, {}, id).ok());
  EXPECT_TRUE(registry_.CreateMap("mb", {}, "b").ok());
  EXPECT_EQ(registry_.CreateMap("ma", {}, "a").status().code(), absl::StatusCode::kAlreadyExists);
}

TEST_F(RegistryTest, EveryMapHasAnEpochOfItsOwn) {
  const std::uint64_t first = (*registry_.CreateMap("m", {}, ""))->epoch();
  const std::uint64_t second = Open("n", "s")->map()->epoch();
  ASSERT_TRUE(registry_.DeleteMap("m", "", false).ok());
  const std::uint64_t again = (*registry_.CreateMap("m", {}, ""))->epoch();
  EXPECT_EQ(first, kEpoch);
  EXPECT_LT(first, second);
  EXPECT_LT(second, again);
}

TEST_F(RegistryTest, AMapThatIsFedIsNotDeletedUnlessForced) {
  const auto stream = std::make_shared<FakeStream>();
  Open("m", "s1", stream);
  Open("m", "s2");
  const absl::Status refused = registry_.DeleteMap("m", "d", false);
  EXPECT_EQ(refused.code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_EQ(std::string(refused.message()),
            "map is m, which is fed by the sessions s1, s2, want none, or force");
  EXPECT_TRUE(registry_.FindMap("m").ok());
  EXPECT_FALSE(stream->end().has_value());

  EXPECT_TRUE(registry_.DeleteMap("m", "d", true).ok()) << "a refusal is not remembered";
  EXPECT_EQ(registry_.FindMap("m").status().code(), absl::StatusCode::kNotFound);
  ASSERT_TRUE(stream->end().has_value());
  EXPECT_EQ(stream->end()->code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(std::string(stream->end()->message()),
            "map is m, which has been deleted, want an existing map");
  EXPECT_TRUE(registry_.Sessions().empty());
  EXPECT_EQ(registry_.FindRobot("robot-s1").status().code(), absl::StatusCode::kNotFound);
}

TEST_F(RegistryTest, ARefusalNamesTenSessionsAndCountsTheRest) {
  for (int i = 0; i < 12; ++i) Open("m", "s" + std::to_string(i));
  EXPECT_THAT(std::string(registry_.DeleteMap("m", "", false).message()),
              testing::HasSubstr("s8, s9 and 2 more"));
}

// A robot whose radio link was down when the map was deleted comes back with scans that begin in
// the middle of its way: they must not become the beginning of a new map.
TEST_F(RegistryTest, ASessionThatWasCutOffCannotBeResumed) {
  Open("m", "s1");
  ASSERT_TRUE(registry_.DeleteMap("m", "", true).ok());
  const absl::Status resumed = registry_.OpenSession(SetupOf("m", "robot-s1", "s1")).status();
  EXPECT_EQ(resumed.code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_EQ(std::string(resumed.message()),
            "open.session is s1, which ended when its map was deleted, want a new id");
  EXPECT_FALSE(registry_.FindMap("m").ok());
  EXPECT_NE(Open("m", "s2"), nullptr);
}

TEST_F(RegistryTest, WhoStillHasADeletedMapSeesItEmptyAndHearsWhy) {
  const std::shared_ptr<MapActor> map = Open("m", "s")->map();
  const MapVersion before = map->snapshot()->version;
  ASSERT_TRUE(registry_.DeleteMap("m", "", true).ok());
  EXPECT_EQ(map->status().code(), absl::StatusCode::kNotFound);
  EXPECT_GT(map->snapshot()->version.revision, before.revision);
  EXPECT_EQ(map->snapshot()->version.epoch, before.epoch);
  EXPECT_TRUE(map->snapshot()->sessions.empty());
  absl::Status corrected;
  map->Correct("s", "", {{1, {}}}, [&](const absl::StatusOr<CorrectionAnswer>& answer) {
    corrected = answer.status();
  });
  EXPECT_EQ(corrected.code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(wire::FieldOf(corrected), "map");
  EXPECT_EQ(map->AddSession("t", "r", {}).code(), absl::StatusCode::kNotFound);
}

TEST_F(RegistryTest, CorrectionsInFlightAreAnsweredWhenTheMapIsDeleted) {
  const std::shared_ptr<MapActor> map = Open("m", "s")->map();
  std::atomic<int> num_answers{0};
  for (int i = 0; i < 100; ++i)
    map->Correct("s", std::to_string(i), {{1, {}}},
                 [&](const absl::StatusOr<CorrectionAnswer>& /*answer*/) { ++num_answers; });
  ASSERT_TRUE(registry_.DeleteMap("m", "", true).ok());
  EXPECT_EQ(num_answers.load(), 100);
}

// Sessions are opened and corrected, and maps read, while the map is deleted and made again.
TEST_F(RegistryTest, DeletionRacesWithEverything) {
  constexpr int kRounds = 60;
  std::atomic<bool> done{false};
  std::atomic<int> num_asked{0}, num_answers{0};
  struct Opened {
    std::shared_ptr<SessionActor> session;
    std::shared_ptr<FakeStream> stream;
    bool attached = false;
  };
  std::vector<Opened> opened[2];
  const auto robots = [&](int thread) {
    for (int i = 0; i < kRounds; ++i) {
      const std::string id = std::to_string(thread) + "-" + std::to_string(i);
      auto session = registry_.OpenSession(SetupOf("m", "robot-" + id, id));
      ASSERT_TRUE(session.ok()) << session.status();
      const auto stream = std::make_shared<FakeStream>();
      const bool attached = (*session)->mailbox().Attach(stream).ok();
      ++num_asked;
      (*session)->map()->Correct(
          id, id, {{1, {}}},
          [&](const absl::StatusOr<CorrectionAnswer>& /*answer*/) { ++num_answers; });
      opened[thread].push_back({*session, stream, attached});
    }
  };
  std::thread first(robots, 0), second(robots, 1);
  std::thread reader([&] {
    while (!done) {
      for (const auto& map : registry_.Maps())
        EXPECT_EQ(map->snapshot()->version.epoch, map->epoch());
      std::this_thread::yield();
    }
  });
  std::thread deleter([&] {
    for (int i = 0; i < kRounds; ++i) {
      const absl::Status status = registry_.DeleteMap("m", "", true);
      EXPECT_TRUE(status.ok() || absl::IsNotFound(status)) << status;
      std::this_thread::yield();
    }
  });
  first.join();
  second.join();
  deleter.join();
  done = true;
  reader.join();
  (void)registry_.DeleteMap("m", "", true);
  EXPECT_EQ(num_answers.load(), num_asked.load());
  EXPECT_TRUE(registry_.Sessions().empty());
  for (const auto& of_thread : opened)
    for (const Opened& each : of_thread) {
      EXPECT_FALSE(each.session->map()->status().ok());
      EXPECT_FALSE(each.session->active());
      EXPECT_EQ(each.stream->end().has_value(), each.attached);
    }
}

}  // namespace
}  // namespace gem
