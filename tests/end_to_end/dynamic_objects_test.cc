// A real cyclist rides through a real recording: he must leave no trail in the local map.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

#include "tests/end_to_end/exported_map.h"
#include "tests/end_to_end/process.h"

namespace gem::test {
namespace {

constexpr double kCellSize_m = 0.2;

struct Place {
  double x_m;
  double y_m;
};

/// Where the rider's body was, one place every two scans, from scan 50 of the 80 to scan 74. Read
/// off the recording: clusters 0.9 to 2 m over the ground that stay in a 0.3 m square for fewer
/// than ten scans. Frame of the poses.
constexpr Place kRidersTrack[] = {{101.3, -20.6}, {102.5, -20.8}, {103.6, -20.9}, {104.7, -21.0},
                                  {105.6, -21.2}, {106.8, -21.4}, {107.9, -21.5}, {108.9, -21.7},
                                  {110.1, -21.8}, {111.1, -21.9}, {112.2, -22.1}, {113.2, -22.2},
                                  {114.3, -22.4}};

/// Wider than the rider's shoulders and handlebar.
constexpr double kSweptHalfWidth_m = 0.5;

/// A bollard 0.7 m high stands beside the track: 60 scans before and after the rider see it. It
/// must stay.
constexpr Place kBollard{104.8, -21.6};
constexpr double kBollardReach_m = 0.5;

/// The ground there lies between 0 and 0.15 m, the rider between 0.4 and 1.8 m.
constexpr double kStanding_m = 0.35;

double DistanceToSegment(Place p, Place a, Place b) {
  const double dx = b.x_m - a.x_m, dy = b.y_m - a.y_m;
  const double along =
      std::clamp(((p.x_m - a.x_m) * dx + (p.y_m - a.y_m) * dy) / (dx * dx + dy * dy), 0.0, 1.0);
  return std::hypot(p.x_m - a.x_m - along * dx, p.y_m - a.y_m - along * dy);
}

bool OnSweptPath(Place p) {
  for (std::size_t i = 1; i < std::size(kRidersTrack); ++i) {
    if (DistanceToSegment(p, kRidersTrack[i - 1], kRidersTrack[i]) <= kSweptHalfWidth_m)
      return true;
  }
  return false;
}

struct Count {
  int known = 0;
  int obstacles = 0;  ///< traversability says so: things that stand there, and kerbs beside them
  int trail = 0;      ///< obstacles higher than any ground, the bollard apart
  int doubtful =
      0;  ///< so high too, but not an obstacle: a lone cell that no ray has passed below yet
  int bollard = 0;  ///< the same, of the bollard
};

ExportedMap Layer(const ServerProcess& server, const ScratchDir& scratch,
                  const std::string& layer) {
  const std::string file = scratch.File(layer + ".xyz");
  const Finished local = Gem({"local", "--server", server.address(), "--robot", "r", "--layer",
                              layer, "--format", "xyz", "--out", file});
  EXPECT_EQ(local.exit_code, 0) << local.output;
  return ReadXyz(file, kCellSize_m);
}

/// Replays the first `scans` scans at 10 Hz and counts what the local map says of the swept path.
Count CountOnSweptPath(const std::string& scans, std::vector<std::string> server_options) {
  const ServerProcess server(std::move(server_options));
  const ScratchDir scratch;
  const Finished replay =
      Gem({"replay", "kitti", std::string(std::getenv("GEM_DATA_DIR")) + "/kitti_raw_0001",
           "--server", server.address(), "--map", "m", "--robot", "r", "--rate", "10",
           "--local_size_m", "40", "--scans", scans});
  EXPECT_EQ(replay.exit_code, 0) << replay.output;
  const ExportedMap traversability = Layer(server, scratch, "traversability");
  Count count;
  for (const auto& [cell, elevation_m] : Layer(server, scratch, "elevation")) {
    const Place center{(static_cast<double>(cell.first) + 0.5) * kCellSize_m,
                       (static_cast<double>(cell.second) + 0.5) * kCellSize_m};
    if (!OnSweptPath(center)) continue;
    ++count.known;
    const auto annotated = traversability.find(cell);
    const bool is_obstacle = annotated == traversability.end() || annotated->second <= 0.7;
    if (is_obstacle) ++count.obstacles;
    if (elevation_m <= kStanding_m) continue;
    const bool is_bollard =
        std::hypot(center.x_m - kBollard.x_m, center.y_m - kBollard.y_m) < kBollardReach_m;
    ++(is_bollard ? count.bollard : is_obstacle ? count.trail : count.doubtful);
  }
  return count;
}

void Print(const char* when, const Count& count) {
  std::printf("%-29s %3d cells known, %3d obstacles, of which trail %3d, bollard %d; doubtful %d\n",
              when, count.known, count.obstacles, count.trail, count.bollard, count.doubtful);
}

TEST(Cyclist, LeavesNoTrailInTheLocalMap) {
  if (std::getenv("GEM_DATA_DIR") == nullptr) {
    GTEST_SKIP() << "SKIPPED: GEM_DATA_DIR does not name unpacked recordings";
  }
  const Count during = CountOnSweptPath("64", {});
  const Count after = CountOnSweptPath("80", {});
  // The control: never clear (no ray is 100 standard deviations below anything).
  const Count uncleared = CountOnSweptPath("80", {"--local_map.clear_sigmas", "100"});
  Print("while he rides there", during);
  Print("after he left", after);
  Print("after he left, never clearing", uncleared);
  EXPECT_GT(during.trail, 5);
  EXPECT_GT(uncleared.trail, 50) << "the control shows no trail to clear";
  EXPECT_EQ(after.trail, 0);
  EXPECT_GT(after.bollard, 0) << "what stands still was cleared";
  EXPECT_LE(after.obstacles, uncleared.obstacles / 10);
}

}  // namespace
}  // namespace gem::test
