// The main job, through the shipped binaries: real scans in, a corrected map out.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "tests/end_to_end/exported_map.h"
#include "tests/end_to_end/process.h"

namespace gem::test {
namespace {

constexpr double kCellSize_m = 0.2;

std::string Slurp(const std::string& file) {
  std::ifstream in(file);
  return {std::istreambuf_iterator<char>(in), {}};
}

struct MapOnDisk {
  ExportedMap elevation;
  ExportedMap traversability;
  std::string elevation_text;
};

/// Runs `gem` with a server's address and expects success.
void MustRun(const ServerProcess& server, std::vector<std::string> arguments) {
  arguments.insert(arguments.end(), {"--server", server.address()});
  const Finished run = Gem(arguments);
  ASSERT_EQ(run.exit_code, 0) << run.output;
}

MapOnDisk Export(const ServerProcess& server, const ScratchDir& scratch, const std::string& map) {
  MapOnDisk result;
  for (const char* layer : {"elevation", "traversability"}) {
    const std::string file = scratch.File(map + "." + layer + ".xyz");
    MustRun(server, {"export", "--map", map, "--layer", layer, "--format", "xyz", "--out", file});
    (std::string(layer) == "elevation" ? result.elevation : result.traversability) =
        ReadXyz(file, kCellSize_m);
  }
  result.elevation_text = Slurp(scratch.File(map + ".elevation.xyz"));
  return result;
}

/// The directory with unpacked recordings, or nothing: the test is then skipped, loudly.
const char* DataDir() { return std::getenv("GEM_DATA_DIR"); }

#define GEM_SKIP_WITHOUT_DATA() \
  if (DataDir() == nullptr)     \
  GTEST_SKIP() << "SKIPPED: GEM_DATA_DIR does not name unpacked recordings"

class KittiKeyframes : public testing::Test {
 protected:
  /// Replays the recording into a map of its own.
  MapOnDisk Replay(const std::string& map, std::vector<std::string> options) {
    std::vector<std::string> arguments = {
        "replay",  "kitti",     std::string(DataDir()) + "/kitti_00_keyframes", "--map", map,
        "--robot", "car-" + map};
    arguments.insert(arguments.end(), options.begin(), options.end());
    MustRun(server_, arguments);
    return Export(server_, scratch_, map);
  }

  ServerProcess server_;
  ScratchDir scratch_;
};

TEST_F(KittiKeyframes, CorrectedAtTheEndEqualsCorrectedAfterEveryScanCellForCell) {
  GEM_SKIP_WITHOUT_DATA();
  const std::vector<std::string> poses = {"--poses", "poses_odometry.txt", "--corrected",
                                          "poses_corrected.txt", "--correct_at"};
  std::vector<std::string> at_end = poses, at_every = poses;
  at_end.push_back("end");
  at_every.push_back("every");
  const MapOnDisk end = Replay("end", at_end);
  const MapOnDisk every = Replay("every", at_every);
  const MapOnDisk never = Replay("never", {"--poses", "poses_odometry.txt"});
  EXPECT_GT(end.elevation.size(), 25'000u);
  EXPECT_EQ(end.elevation, every.elevation);
  EXPECT_TRUE(end.elevation_text == every.elevation_text) << "the exported files differ";
  EXPECT_NE(end.elevation, never.elevation) << "the correction moved nothing";
}

TEST_F(KittiKeyframes, ShorterSubmapsComeCloserToTheMapOfTheCorrectedPoses) {
  GEM_SKIP_WITHOUT_DATA();
  double last_median = 0.11;  // drift of this odometry within 20 m: median 0.11 m in z
  std::printf("submap length  cells   median |dz|  p95 |dz|\n");
  for (const char* length : {"20", "10", "5", "2"}) {
    const std::string name = length;
    const MapOnDisk truth = Replay("from-start-" + name,
                                   {"--poses", "poses_corrected.txt", "--submap_length_m", length});
    const MapOnDisk bent = Replay(
        "bent-" + name, {"--poses", "poses_odometry.txt", "--corrected", "poses_corrected.txt",
                         "--correct_at", "end", "--submap_length_m", length});
    const Difference d =
        Compare(truth.elevation, truth.traversability, bent.elevation, bent.traversability);
    std::printf("%10s m %8zu  %9.4f m %9.4f m\n", length, d.num_cells, d.median, d.p95);
    EXPECT_GT(d.num_cells, 10'000u);
    EXPECT_LE(d.median, last_median) << "submaps of " << length << " m";
    last_median = d.median;
  }
}

TEST(Segments, DriftBetweenSubmapsLeavesNoTraceAfterTheCorrection) {
  ServerProcess server;
  ScratchDir scratch;
  MustRun(server, {"simulate", "segments", "--map", "true", "--robot", "a", "--drift", "0"});
  MustRun(server, {"simulate", "segments", "--map", "drifted", "--robot", "b"});
  MustRun(server,
          {"simulate", "segments", "--map", "corrected", "--robot", "c", "--correct_at", "end"});
  const MapOnDisk truth = Export(server, scratch, "true");
  const MapOnDisk drifted = Export(server, scratch, "drifted");
  const MapOnDisk corrected = Export(server, scratch, "corrected");
  const Difference before =
      Compare(truth.elevation, truth.traversability, drifted.elevation, drifted.traversability);
  const Difference after =
      Compare(truth.elevation, truth.traversability, corrected.elevation, corrected.traversability);
  std::printf(
      "drifted: max |dz| %.4f m over %zu cells; corrected: max |dz| %.6f m over %zu cells\n",
      before.max, before.num_cells, after.max, after.num_cells);
  EXPECT_EQ(corrected.elevation.size(), truth.elevation.size());
  EXPECT_GT(after.num_cells, 3'000u);
  EXPECT_GT(before.max, 0.1) << "the drift is too small to show anything";
  EXPECT_LE(after.max, 0.001);
}

TEST(Correction, TheLocalMapNeverNotices) {
  ServerProcess server;
  ScratchDir scratch;
  std::vector<std::string> texts;
  for (const char* at : {"1", "end"}) {
    const std::string map = std::string("m-") + at, robot = std::string("r-") + at;
    MustRun(server, {"simulate", "flat", "--map", map, "--robot", robot, "--correct_at", at});
    const std::string file = scratch.File(robot);
    MustRun(server,
            {"local", "--robot", robot, "--layer", "elevation", "--format", "xyz", "--out", file});
    texts.push_back(Slurp(file));
  }
  EXPECT_FALSE(texts[0].empty());
  EXPECT_TRUE(texts[0] == texts[1]);
}

}  // namespace
}  // namespace gem::test
