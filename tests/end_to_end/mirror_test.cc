// A planner at the other end of a link that breaks again and again, while a robot streams and SLAM
// corrects: every snapshot that MapMirror hands out is one version of the server's map, and in the
// end it is the newest.
#include "client/map_mirror.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "client/map_client.h"
#include "tests/end_to_end/process.h"
#include "tests/end_to_end/streaming_robot.h"
#include "tests/network/tcp_proxy.h"

namespace gem::test {
namespace {

using client::MapTile;
using client::MirroredMap;

constexpr int kNumFaults = 100;
constexpr std::size_t kScansBetweenCorrections = 10;
/// Replaced versions that the mirror is behind at most, so that the server still has them.
constexpr std::size_t kCorrectionsAhead = 6;
constexpr double kPatience_s = 120;

const client::CellSelection kCells = {{Layer::kElevation, Layer::kVariance, Layer::kTraversability},
                                      client::CellEncoding::kCompact};

std::shared_ptr<const client::Connection> Connect(const std::string& address) {
  client::ConnectionOptions connection;
  connection.address = address;
  return std::make_shared<const client::Connection>(connection);
}

/// Every kind of fault in turn. At a random moment: some while the watch is being opened, most in
/// the middle of a change.
std::vector<Fault> RandomFaults(unsigned seed) {
  std::mt19937 random(seed);
  std::vector<Fault> faults;
  for (int i = 0; i < kNumFaults; ++i) {
    Fault fault;
    fault.kind = static_cast<Fault::Kind>(1 + i % 3);
    fault.counts = Fault::Counts::kServer;
    fault.after_bytes = random() % 5 == 0 ? random() % 1000 : random() % 150'000;
    faults.push_back(fault);
  }
  return faults;
}

std::vector<MapTile> TilesOf(const MirroredMap& map) {
  std::vector<MapTile> tiles;
  for (const auto& [index, tile] : map.tiles) tiles.push_back(tile);
  std::sort(tiles.begin(), tiles.end(), [](const MapTile& a, const MapTile& b) {
    return std::pair(a.index.y, a.index.x) < std::pair(b.index.y, b.index.x);
  });
  return tiles;
}

/// Holds each snapshot against what the server says of the same version. On the mirror's thread.
class Inspector {
 public:
  explicit Inspector(const std::string& address) : client_(Connect(address)) {}

  void Inspect(const std::shared_ptr<const MirroredMap>& map,
               const std::vector<TileIndex>& changed) {
    ++num_inspected_;
    if (last_ != nullptr) {
      EXPECT_EQ(map->version.epoch, last_->version.epoch);
      EXPECT_GT(map->version.revision, last_->version.revision);
    }
    ExpectChanged(*map, changed);
    const std::vector<MapTile> tiles = TilesOf(*map);
    std::vector<TileIndex> indices;
    for (const MapTile& tile : tiles) indices.push_back(tile.index);
    client::TileQuery query;
    query.at = map->version;
    const auto server = client_.GetTiles("site", indices, kCells, query);
    ASSERT_TRUE(server.ok()) << server.status();
    EXPECT_EQ(DifferenceOf(tiles, server->tiles), "") << "revision " << map->version.revision;
    last_ = map;
  }
  int num_inspected() const { return num_inspected_; }

 private:
  /// `changed` are the tiles that differ from the snapshot before, no more and no fewer.
  void ExpectChanged(const MirroredMap& map, std::vector<TileIndex> changed) const {
    const auto etag = [](const MirroredMap* of, TileIndex index) {
      const auto found = of == nullptr ? decltype(of->tiles.end())() : of->tiles.find(index);
      return of == nullptr || found == of->tiles.end() ? 0 : found->second.etag;
    };
    std::size_t num_changed = 0;
    for (const auto& [index, tile] : map.tiles)
      num_changed += etag(last_.get(), index) != tile.etag;
    for (const TileIndex index : changed) EXPECT_NE(etag(last_.get(), index), etag(&map, index));
    if (last_ != nullptr)
      for (const auto& [index, tile] : last_->tiles) num_changed += !map.tiles.contains(index);
    EXPECT_EQ(changed.size(), num_changed);
  }

  const client::MapClient client_;
  std::shared_ptr<const MirroredMap> last_;
  std::atomic<int> num_inspected_{0};
};

/// The truth, and every other time a hand's breadth above it: every tile changes.
std::vector<StampedPose<Global, Base>> Corrected(const Drive& drive, std::size_t num_scans,
                                                 bool raised) {
  auto poses = drive.TrueUntil(num_scans);
  for (auto& [stamp_ns, T_G_B] : poses)
    if (raised) T_G_B = Pose<Global, Global>::FromTranslation(0, 0, 0.1) * T_G_B;
  return poses;
}

void WaitUntilItShows(const client::MapMirror& mirror, const MapVersion& version) {
  std::optional<MapVersion> seen;
  while (!seen || seen->revision < version.revision) {
    const auto map = mirror.WaitForOther(seen, kPatience_s);
    ASSERT_TRUE(map.ok()) << map.status();
    seen = (*map)->version;
  }
}

TEST(MapMirror, OverALinkThatBreaksIsAlwaysOneVersionAndInTheEndTheNewest) {
  const ServerProcess server(
      {"--publish_hz", "50", "--pose_wait_s_max", "10", "--revision_retention_s", "600"});
  SceneOptions scene;
  scene.name = "block";
  scene.rings = 8;
  scene.azimuths = 128;
  scene.scans_max = 300;
  const Drive drive = Simulate(scene);

  const std::vector<Fault> faults = RandomFaults(/*seed=*/11);
  const TcpProxy radio(server.address(), [&](int connection) {
    return connection < kNumFaults ? faults[static_cast<std::size_t>(connection)] : Fault();
  });
  Inspector inspector(server.address());
  client::MirrorOptions options;
  options.map = "site";
  options.cells = kCells;
  options.retry.backoff_s_min = options.retry.backoff_s_max = 0.002;
  options.on_version = [&](const auto& map, const auto& changed) {
    inspector.Inspect(map, changed);
  };
  const client::MapMirror mirror(Connect(radio.address()), options);

  StreamingRobot robot(server.address(), SetupOf(drive, "site", "rover", "monday"), drive);
  const client::MapClient slam(Connect(server.address()));
  std::vector<MapVersion> corrected;
  std::size_t num_sent = 0;
  while (num_sent < drive.scans.size() || radio.num_faults() < kNumFaults) {
    const std::size_t end = std::min(num_sent + kScansBetweenCorrections, drive.scans.size());
    ASSERT_TRUE(robot.Send(num_sent, end).ok());
    ASSERT_TRUE(robot.client().WaitUntilFused().ok());
    num_sent = end;
    const auto result = slam.CorrectTrajectory(
        {"site", "monday", "", Corrected(drive, num_sent, corrected.size() % 2 == 1)});
    ASSERT_TRUE(result.ok()) << result.status();
    corrected.push_back(result->version);
    if (corrected.size() > kCorrectionsAhead) {
      ASSERT_NO_FATAL_FAILURE(
          WaitUntilItShows(mirror, corrected[corrected.size() - 1 - kCorrectionsAhead]));
    }
  }
  const auto closed = robot.client().Close();
  ASSERT_TRUE(closed.ok()) << closed.status();
  ASSERT_NO_FATAL_FAILURE(WaitUntilItShows(mirror, closed->version));

  EXPECT_EQ(radio.num_faults(), kNumFaults);
  EXPECT_GT(inspector.num_inspected(), 20) << "snapshots in the midst";
  const auto newest = slam.ReadMap("site", std::nullopt, kCells);
  ASSERT_TRUE(newest.ok()) << newest.status();
  EXPECT_EQ(mirror.map()->version, newest->tiles.version);
  EXPECT_GT(newest->tiles.tiles.size(), 5u);
  EXPECT_EQ(DifferenceOf(TilesOf(*mirror.map()), newest->tiles.tiles), "");
  const auto stats = mirror.stats();
  EXPECT_GT(stats.num_reconnects, 20u);
  EXPECT_EQ(stats.num_resyncs, 0u) << "what was held was always of use";
}

}  // namespace
}  // namespace gem::test
