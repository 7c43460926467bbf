// Twelve robots at once, four on each of three maps of one server, while they are corrected and
// read: what it comes to is what the same robots leave behind one after the other.
#include <gmock/gmock.h>

#include <array>
#include <atomic>
#include <cmath>
#include <map>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "proto/wire/correction.h"
#include "tests/server/test_server.h"

namespace gem {
namespace {

constexpr std::uint64_t kScans = 40;
constexpr std::array<const char*, 3> kMaps = {"north", "yard", "south"};
/// Where each robot of a map drives, along x. The first and the last share their ground; the others
/// are alone on their tiles, which are 64 m wide.
constexpr std::array<double, 4> kLanes_m = {0, 100, 200, 0};

struct FleetRobot {
  std::string map;
  std::string name;
  double lane_m = 0;
};

std::vector<FleetRobot> Fleet() {
  std::vector<FleetRobot> fleet;
  for (const char* map : kMaps)
    for (std::size_t i = 0; i < kLanes_m.size(); ++i)
      fleet.push_back({map, std::string(map) + std::to_string(i), kLanes_m[i]});
  return fleet;
}

double PositionOf(std::uint64_t seq) { return 0.5 * static_cast<double>(seq); }

/// Ground within 6 cm of z = 0 of O: no two scans of it, and no two robots', are the same.
v1::Scan BumpyScan(const FleetRobot& robot, std::uint64_t seq) {
  v1::Scan scan = FlatScan(seq, PositionOf(seq));
  const std::uint64_t seed = seq * 31 + static_cast<std::uint64_t>(robot.name.back());
  std::vector<ScanPoint> points;
  for (int i = 0; i < 32 * 32; ++i) {
    const auto bump = static_cast<int>((seed + static_cast<std::uint64_t>(i) * 17) % 7) - 3;
    points.push_back({0.25f * static_cast<float>(i % 32 - 16) + 0.125f,
                      0.25f * static_cast<float>(i / 32 - 16) + 0.125f,
                      -1 + 0.02f * static_cast<float>(bump), 0});
  }
  wire::PointsToProto(points, &scan);
  return scan;
}

/// What SLAM says after scan `seq`: all so far is raised by a metre, or is where it was.
void Correct(TestServer& server, const FleetRobot& robot, std::uint64_t seq) {
  const double raise_m = seq % 20 == 0 ? 0 : 1;
  wire::CorrectionRequest request{robot.map, robot.name, "", {}};
  for (std::uint64_t i = 1; i <= seq; ++i)
    request.poses.push_back({StampOf(i), Pose<Global, Base>::FromTranslation(
                                             PositionOf(i), robot.lane_m, 1 + raise_m)});
  v1::CorrectTrajectoryRequest proto;
  wire::ToProto(request, &proto);
  v1::CorrectTrajectoryResponse response;
  const grpc::Status status = TestServer::Call(
      server.ingest(), &v1::IngestService::Stub::CorrectTrajectory, proto, response);
  EXPECT_TRUE(status.ok()) << robot.name << ": " << status.error_message();
}

void Drive(TestServer& server, const FleetRobot& robot) {
  v1::OpenSession open = TestOpen(robot.name, robot.name);
  open.set_map(robot.map);
  open.mutable_map_setup()->set_submap_length_m(3);
  open.mutable_map_from_odom()->set_y(robot.lane_m);
  open.mutable_map_from_odom()->set_qw(1);
  TestStream stream(server.ingest(), open);
  for (std::uint64_t seq = 1; seq <= kScans; ++seq) {
    ASSERT_TRUE(stream.Send(BumpyScan(robot, seq))) << robot.name;
    if (seq % 10 != 0) continue;
    ASSERT_TRUE(stream.ReadUntilFused(seq)) << robot.name;
    Correct(server, robot, seq);
  }
  ASSERT_TRUE(stream.SendClose());
  ASSERT_TRUE(stream.ReadUntilClosed()) << robot.name;
  EXPECT_EQ(stream.closed().num_scans_fused(), kScans);
  EXPECT_TRUE(stream.problems().empty());
}

/// Reads one map again and again until told to stop. No version may show half of a correction of a
/// robot that is alone on its ground.
void Watch(TestServer& server, const std::string& map, const std::atomic<bool>& done) {
  v1::GetMapRequest request;
  request.set_map(map);
  v1::GetMapResponse response;
  while (!done &&
         !TestServer::Call(server.maps(), &v1::MapService::Stub::GetMap, request, response).ok()) {
  }
  std::uint64_t last_revision = 0;
  while (!done) {
    const TestMap read = FetchMap(server, map);
    EXPECT_GE(read.version.revision, last_revision);
    last_revision = read.version.revision;
    std::map<int, std::set<double>> heights_m;  // by the hundred metres of the lane
    for (const auto& [cell, height] : read.Cells())
      heights_m[cell.y / 150].insert(std::round(height));
    for (const int lane : {1, 2})
      EXPECT_LE(heights_m[lane].size(), 1u) << map << " " << read.version.revision;
  }
}

struct Remains {
  std::map<std::string, std::map<std::string, std::uint64_t>> etags;  ///< of all tiles, by map
  std::map<std::string, std::map<CellIndex, float>> heights_m;        ///< of all cells, by map
};

Remains Collect(TestServer& server) {
  Remains remains;
  for (const char* map : kMaps) {
    const TestMap read = FetchMap(server, map);
    for (const wire::DecodedTile& tile : read.tiles)
      remains.etags[map][std::to_string(tile.address.index.x) + "," +
                         std::to_string(tile.address.index.y)] = tile.etag;
    for (const auto& [cell, height] : read.Cells()) remains.heights_m[map][cell] = height;
  }
  return remains;
}

TEST(Fleet, TwelveRobotsAtOnceLeaveWhatTheyLeaveOneAfterTheOther) {
  TestServer together, in_turn;
  const std::vector<FleetRobot> fleet = Fleet();
  {
    std::atomic<bool> done{false};
    std::vector<std::thread> readers, robots;
    for (const char* map : kMaps) readers.emplace_back([&, map] { Watch(together, map, done); });
    for (const FleetRobot& robot : fleet) robots.emplace_back([&] { Drive(together, robot); });
    for (std::thread& robot : robots) robot.join();
    done = true;
    for (std::thread& reader : readers) reader.join();
  }
  // Backwards: who comes first must not matter, not even to those who share their ground.
  for (auto robot = fleet.rbegin(); robot != fleet.rend(); ++robot) Drive(in_turn, *robot);

  const Remains of_all = Collect(together), of_each = Collect(in_turn);
  for (const char* map : kMaps) {
    SCOPED_TRACE(map);
    EXPECT_EQ(of_all.etags.at(map), of_each.etags.at(map));
    EXPECT_EQ(of_all.heights_m.at(map), of_each.heights_m.at(map));
    // Windows of 16 cells a side; 40 scans, one cell apart: 55 columns and 16 rows on each of three
    // grounds.
    EXPECT_EQ(of_all.heights_m.at(map).size(), 3u * 55u * 16u);
  }
}

}  // namespace
}  // namespace gem
