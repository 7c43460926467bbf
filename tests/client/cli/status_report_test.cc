#include "client/cli/status_report.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "client/cli/progress_bar.h"

namespace gem::client {
namespace {

using ::testing::HasSubstr;

ServerStatus Status() {
  ServerStatus status{"0.1.0", "cpu", 12.5, {}, {}};
  status.sessions.push_back({"yard", "rover", "mon\"day", true, true, 10, 1, 3, 2048, 11});
  status.timings.push_back({"local", "fuse", 4, 0.010, 0.005});
  status.timings.push_back({"local", "clear", 0, 0, 0});
  return status;
}

MapInfo Yard() {
  MapInfo map;
  map.id = "yard";
  map.cell_size_m = 0.25;
  map.submap_length_m = 20;
  map.version = {3, 17};
  map.num_submaps = 2;
  map.submap_bytes = 3 << 20;
  map.sessions = {"a", "b"};
  map.num_sessions = 2;
  return map;
}

TEST(StatusReport, IsAnObjectForPrograms) {
  EXPECT_EQ(
      StatusJson(Status(), {Yard()}),
      "{\"server_version\":\"0.1.0\",\"backend\":\"cpu\",\"uptime_s\":12.5,\"maps\":[{\"id\":"
      "\"yard\",\"cell_size_m\":0.25,\"submap_length_m\":20,\"traversable_only\":false,\"epoch\":3,"
      "\"revision\":17,\"num_submaps\":2,\"num_points\":0,\"submap_bytes\":3145728,\"num_tiles\":0,"
      "\"num_sessions\":2,\"sessions\":[\"a\",\"b\"]}],\"sessions\":[{\"map\":\"yard\",\"robot\":"
      "\"rover\","
      "\"session\":\"mon\\\"day\",\"active\":true,\"connected\":true,\"num_scans_fused\":10,"
      "\"num_scans_refused\":1,\"num_scans_dropped\":3,\"queue_bytes\":2048,\"fused_seq\":11}],"
      "\"timings\":[{\"mapper\":\"local\",\"stage\":\"fuse\",\"count\":4,\"mean_ms\":2.5,\"max_"
      "ms\":5,\"total_s\":0.01},{"
      "\"mapper\":\"local\",\"stage\":\"clear\",\"count\":0,\"mean_ms\":0,\"max_ms\":0,\"total_s\":"
      "0}]}\n");
}

TEST(StatusReport, IsATableForPeople) {
  const std::string table = StatusTable(Status(), {Yard()});
  EXPECT_THAT(table, HasSubstr("gem_server 0.1.0, backend cpu, up 12 s"));
  EXPECT_THAT(table,
              HasSubstr("yard                    0.25        20        2        2          0      "
                        "3.00       0           17"));
  EXPECT_THAT(table, HasSubstr("streaming       10        1        3        2.0"));
  EXPECT_THAT(table, HasSubstr("local    fuse            2.500      5.000          4"));
}

TEST(ProgressLine, ShowsRateAndRemainingTimeInTheGivenWidth) {
  const std::string half = ProgressLine("kitti", {50, 0, 100}, 10, 60);
  EXPECT_EQ(half, "kitti [===========>          ] 50/100  5.0 scans/s  ETA 10 s");
  EXPECT_EQ(half.size(), 60u);
  const std::string all = ProgressLine("kitti", {100, 0, 100}, 10, 60);
  EXPECT_EQ(all, "kitti [==============================] 100/100  10.0 scans/s");
  EXPECT_EQ(all.size(), 60u);
}

TEST(ProgressLine, CountsWhatAnEarlierRunDidAsDoneButNotAsFast) {
  // 60 of 100 are there, 10 of them sent in 5 s: 2 a second, 20 s for the other 40.
  EXPECT_EQ(ProgressLine("kitti", {60, 50, 100}, 5, 60),
            "kitti [=============>        ] 60/100  2.0 scans/s  ETA 20 s");
}

TEST(ProgressLine, SurvivesNothingDoneAndNothingToDo) {
  EXPECT_EQ(ProgressLine("k", {0, 0, 0}, 0, 30), "k [>        ] 0/0  0.0 scans/s");
  EXPECT_EQ(ProgressLine("k", {3, 0, 10}, 1, 5), "k [] 3/10  3.0 scans/s  ETA 2 s");
}

}  // namespace
}  // namespace gem::client
