#include "client/cli/bench_serving.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace gem::client {
namespace {

using ::testing::HasSubstr;

ServingReport Report() {
  ServingReport report;
  report.scans = "street, 11 scans";
  report.points_per_scan = 120'000;
  report.ingest.push_back(
      {"int16", 4, 720'000, {800, 1, 0.5}, {700, 0.875, 0.75}, {600, 0.75, 2.25}});
  load::ReadingBench reading;
  reading.num_tiles = 40;
  reading.robots_sustained = 12;
  load::ReadResult read;
  read.tiles_per_call = 16;
  read.calls_hz = 100;
  read.tiles_hz = 1600;
  read.call = {1.25, 4.5, 9};
  read.robots = {12, 960, 3, 0, {5, 40, 120}};
  read.server_cores = 0.75;
  reading.flooded.push_back(read);
  report.reading.push_back(reading);
  report.watching.push_back({100, 1, 200, 4e6, 80 << 20, -(1 << 20), 90 << 20, {1, 600, 2, 0, {}}});
  return report;
}

TEST(BenchServing, IsATableForPeople) {
  const std::string table = ServingTable(Report());
  EXPECT_THAT(table, HasSubstr("street, 11 scans, 120000 points each"));
  EXPECT_THAT(table, HasSubstr("int16           4     0.72      800      700    88%       600    "
                               "75%     0.50     0.75     2.25"));
  EXPECT_THAT(table, HasSubstr("12     16      100      1600     1.25     4.50     960      3"));
  EXPECT_THAT(table, HasSubstr("12 robots at 10 Hz are sustained"));
  EXPECT_THAT(table,
              HasSubstr("100            1       200.0      4.00        80.0       -1.00     90.0"));
}

TEST(BenchServing, IsAnObjectForPrograms) {
  const std::string json = ServingJson(Report());
  EXPECT_THAT(json, HasSubstr("\"mapped\":{\"scans_hz\":600,\"share\":0.75,\"cpu_ms\":2.25}"));
  EXPECT_THAT(json, HasSubstr("\"robots_sustained\":12,\"paced\":[],\"flooded\":[{\"num_robots\":"
                              "12,\"tiles_per_call\":16"));
  EXPECT_THAT(json, HasSubstr("\"watching\":[{\"num_watchers\":100,\"num_silent\":1,"));
}

TEST(BenchServing, LeavesOutWhatWasNotMeasured) {
  ServingReport report = Report();
  report.ingest.clear();
  EXPECT_THAT(ServingTable(report), testing::Not(HasSubstr("bare/s")));
  report.reading.clear();
  EXPECT_THAT(ServingTable(report), testing::Not(HasSubstr("sustained")));
}

}  // namespace
}  // namespace gem::client
