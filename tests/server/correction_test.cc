// Two robots in one map, corrections while both stream, and a reader that must never see half of
// one.
#include <gmock/gmock.h>

#include <atomic>
#include <cmath>
#include <map>
#include <set>
#include <thread>

#include "proto/wire/correction.h"
#include "tests/server/test_server.h"

namespace gem {
namespace {

/// Scans of one robot lie 0.5 m apart along x; B is 1 m above the ground.
double PositionOf(std::uint64_t seq) { return 0.5 * static_cast<double>(seq); }

/// True poses of scans 1..num_scans, raised by raise_m.
v1::CorrectTrajectoryRequest RaisedBy(double raise_m, std::uint64_t num_scans,
                                      const std::string& request_id = "") {
  wire::CorrectionRequest request{"site", "a", request_id, {}};
  for (std::uint64_t seq = 1; seq <= num_scans; ++seq)
    request.poses.push_back(
        {StampOf(seq), Pose<Global, Base>::FromTranslation(PositionOf(seq), 0, 1 + raise_m)});
  v1::CorrectTrajectoryRequest proto;
  wire::ToProto(request, &proto);
  return proto;
}

grpc::Status Correct(TestServer& server, const v1::CorrectTrajectoryRequest& request,
                     v1::CorrectTrajectoryResponse& response) {
  return TestServer::Call(server.ingest(), &v1::IngestService::Stub::CorrectTrajectory, request,
                          response);
}

v1::OpenSession OpenWithShortSubmaps(const std::string& robot, const std::string& session) {
  v1::OpenSession open = TestOpen(robot, session);
  open.mutable_map_setup()->set_submap_length_m(3);
  return open;
}

/// What a reader of one version sees of robot A, whose cells have y < 50 m.
struct Seen {
  std::set<CellIndex> cells_a;
  std::set<CellIndex> cells_b;
  std::set<double> heights_a;  ///< rounded to 1 cm
  std::set<double> heights_b;
};

Seen See(const TestMap& map) {
  Seen seen;
  for (const auto& [cell, height] : map.Cells()) {
    const double rounded = std::round(height * 100) / 100 + 0.0;
    const bool is_a = cell.y < 100;  // 0.5 m a cell
    (is_a ? seen.cells_a : seen.cells_b).insert(cell);
    (is_a ? seen.heights_a : seen.heights_b).insert(rounded);
  }
  return seen;
}

// Field requirement: while robots stream and one of them is corrected, no reader may draw one half
// of the map before the correction and the other half after it, and no cell may be missing
// meanwhile.
TEST(Correction, NoVersionShowsHalfOfItAndNoCellIsLost) {
  constexpr std::uint64_t kScans = 60;
  TestServer server;
  std::atomic<bool> done{false};

  const auto drive = [&](const std::string& name, double y_m) {
    v1::OpenSession open = OpenWithShortSubmaps(name, name);
    open.mutable_map_from_odom()->set_y(y_m);
    open.mutable_map_from_odom()->set_qw(1);
    TestStream robot(server.ingest(), open);
    for (std::uint64_t seq = 1; seq <= kScans; ++seq) {
      ASSERT_TRUE(robot.Send(FlatScan(seq, PositionOf(seq))));
      ASSERT_TRUE(robot.ReadUntilFused(seq));
      // A is corrected every tenth scan, up and down in turn.
      if (name == "a" && seq % 10 == 0) {
        v1::CorrectTrajectoryResponse response;
        const grpc::Status status =
            Correct(server, RaisedBy(seq % 20 == 0 ? 0.0 : 1.0, seq), response);
        ASSERT_TRUE(status.ok()) << status.error_message();
        EXPECT_GE(FetchMap(server, "site").version.revision, response.version().revision());
      }
    }
    ASSERT_TRUE(robot.SendClose());
    ASSERT_TRUE(robot.ReadUntilClosed());
    EXPECT_TRUE(robot.problems().empty());
  };

  std::map<std::uint64_t, Seen> versions;
  std::thread reader([&] {
    // The map exists once the first robot has opened its session.
    v1::GetMapRequest request;
    request.set_map("site");
    v1::GetMapResponse response;
    while (
        !TestServer::Call(server.maps(), &v1::MapService::Stub::GetMap, request, response).ok() &&
        !done) {
    }
    std::uint64_t last_revision = 0;
    while (!done) {
      const TestMap map = FetchMap(server, "site");
      EXPECT_GE(map.version.revision, last_revision);
      last_revision = map.version.revision;
      for (const wire::DecodedTile& tile : map.tiles)
        EXPECT_LE(tile.version.revision, map.version.revision);
      versions.emplace(map.version.revision, See(map));
    }
  });
  std::thread a([&] { drive("a", 0); });
  std::thread b([&] { drive("b", 100); });
  a.join();
  b.join();
  done = true;
  reader.join();
  const TestMap last = FetchMap(server, "site");
  versions[last.version.revision] = See(last);

  EXPECT_GT(versions.size(), 5u);
  std::set<double> all_heights_a;
  const Seen* before = nullptr;
  for (const auto& [revision, seen] : versions) {
    EXPECT_LE(seen.heights_a.size(), 1u) << "version " << revision << " shows half a correction";
    EXPECT_LE(seen.heights_b.size(), 1u) << "version " << revision;
    all_heights_a.insert(seen.heights_a.begin(), seen.heights_a.end());
    if (before != nullptr) {
      EXPECT_TRUE(std::includes(seen.cells_a.begin(), seen.cells_a.end(), before->cells_a.begin(),
                                before->cells_a.end()))
          << "version " << revision << " lost cells of A";
      EXPECT_TRUE(std::includes(seen.cells_b.begin(), seen.cells_b.end(), before->cells_b.begin(),
                                before->cells_b.end()))
          << "version " << revision << " lost cells of B";
    }
    before = &seen;
  }
  // 0 and 1 m were both seen, and nothing else; the last correction was back to 0.
  EXPECT_EQ(all_heights_a, (std::set<double>{0.0, 1.0}));
  EXPECT_EQ(versions.rbegin()->second.heights_a, (std::set<double>{0.0}));
  EXPECT_EQ(versions.rbegin()->second.heights_b, (std::set<double>{0.0}));
  // Windows of 16 cells a side; 60 scans, 1 cell apart: 75 columns and 16 rows each.
  EXPECT_EQ(versions.rbegin()->second.cells_a.size(), 75u * 16u);
  EXPECT_EQ(versions.rbegin()->second.cells_b.size(), 75u * 16u);
}

class CorrectedSession : public testing::Test {
 protected:
  CorrectedSession() : robot_(server_.ingest(), OpenWithShortSubmaps("a", "a")) {
    for (std::uint64_t seq = 1; seq <= 20; ++seq)
      EXPECT_TRUE(robot_.Send(FlatScan(seq, PositionOf(seq))));
    EXPECT_TRUE(robot_.SendClose());
    EXPECT_TRUE(robot_.ReadUntilClosed());
  }
  TestServer server_;
  TestStream robot_;
};

TEST_F(CorrectedSession, IsRaisedAsAWhole) {
  v1::CorrectTrajectoryResponse response;
  const grpc::Status status = Correct(server_, RaisedBy(1, 20), response);
  ASSERT_TRUE(status.ok()) << status.error_message();
  EXPECT_GT(response.num_moved_submaps(), 1u);
  EXPECT_GT(response.num_touched_tiles(), 0u);
  EXPECT_EQ(response.num_poses_ahead(), 0u);
  EXPECT_EQ(See(FetchMap(server_, "site")).heights_a, (std::set<double>{1.0}));
  EXPECT_EQ(server_.Metric("gem_correction_seconds_count"), 1);
}

TEST_F(CorrectedSession, ARepeatedRequestGetsTheEarlierAnswer) {
  v1::CorrectTrajectoryResponse first, second, repeated;
  ASSERT_TRUE(Correct(server_, RaisedBy(1, 20, "one"), first).ok());
  ASSERT_TRUE(Correct(server_, RaisedBy(2, 20, "two"), second).ok());
  EXPECT_GT(second.version().revision(), first.version().revision());
  ASSERT_TRUE(Correct(server_, RaisedBy(1, 20, "one"), repeated).ok());
  EXPECT_EQ(repeated.version().revision(), first.version().revision());
  EXPECT_EQ(repeated.num_moved_submaps(), first.num_moved_submaps());
  // And it was not applied again.
  EXPECT_EQ(See(FetchMap(server_, "site")).heights_a, (std::set<double>{2.0}));
}

TEST_F(CorrectedSession, PosesAheadAndBeforeAreCounted) {
  v1::CorrectTrajectoryRequest request = RaisedBy(1, 25);
  request.mutable_poses(0)->set_stamp_ns(StampOf(1) - 1);
  v1::CorrectTrajectoryResponse response;
  ASSERT_TRUE(Correct(server_, request, response).ok());
  EXPECT_EQ(response.num_poses_ahead(), 5u);
  EXPECT_EQ(response.num_poses_ignored(), 1u);
}

TEST_F(CorrectedSession, UnknownSessionsAndMapsAreNamed) {
  v1::CorrectTrajectoryRequest request = RaisedBy(1, 20);
  v1::CorrectTrajectoryResponse response;
  request.set_session("nobody");
  grpc::Status status = Correct(server_, request, response);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::NOT_FOUND);
  EXPECT_EQ(status.error_message(), "session is nobody, want a session that feeds the map site");
  request.set_map("nowhere");
  status = Correct(server_, request, response);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::NOT_FOUND);
  EXPECT_EQ(status.error_message(), "map is nowhere, want an existing map");
}

TEST_F(CorrectedSession, PosesThatAllLieBeforeTheSessionAreOutOfRange) {
  v1::CorrectTrajectoryRequest request = RaisedBy(1, 1);
  request.mutable_poses(0)->set_stamp_ns(1);
  v1::CorrectTrajectoryResponse response;
  EXPECT_EQ(Correct(server_, request, response).error_code(), grpc::StatusCode::OUT_OF_RANGE);
}

TEST_F(CorrectedSession, ManyAtOnceAreAllAnsweredAndTheNewestWins) {
  std::vector<std::thread> callers;
  std::atomic<int> num_answered{0};
  std::atomic<std::uint64_t> newest{0};
  for (int i = 0; i < 8; ++i)
    callers.emplace_back([&] {
      for (int k = 0; k < 10; ++k) {
        v1::CorrectTrajectoryResponse response;
        if (!Correct(server_, RaisedBy(3, 20), response).ok()) continue;
        ++num_answered;
        std::uint64_t seen = newest;
        while (seen < response.version().revision() &&
               !newest.compare_exchange_weak(seen, response.version().revision())) {
        }
      }
    });
  for (std::thread& caller : callers) caller.join();
  EXPECT_EQ(num_answered, 80);
  const TestMap map = FetchMap(server_, "site");
  EXPECT_GE(map.version.revision, newest);
  EXPECT_EQ(See(map).heights_a, (std::set<double>{3.0}));
}

}  // namespace
}  // namespace gem
