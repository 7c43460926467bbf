#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <sstream>

#include "client/cli/top_rates.h"
#include "client/cli/top_screen.h"

namespace gem::client {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

constexpr double kInf = std::numeric_limits<double>::infinity();

/// Ten seconds after its start: one robot, one map, some calls.
TopSample Before() {
  TopSample sample;
  ServerStatus& status = sample.status;
  status = {"0.1.0", "cpu", 10, {}, {}};
  status.sessions.push_back({"yard", "rover", "s1", true, true, 100, 2, 0, 0, 102, 0});
  status.timings.push_back(
      {"local", "fuse", 100, 0.5, 0.08, {{0.001, 40}, {0.01, 90}, {kInf, 100}}});
  status.timings.push_back({"service", "scan", 100, 1, 0.09, {{0.1, 100}, {kInf, 100}}});
  status.calls.push_back(
      {"BatchGetTiles", 50, 1, 0, 1000, 1'000'000, 0.1, {{0.005, 50}, {kInf, 50}}});
  status.calls.push_back({"GetMap", 0, 0, 0, 0, 0, 0, {{0.005, 0}, {kInf, 0}}});
  status.lags.push_back({"yard", 0, 0.2, 0});
  status.process = {100 << 20, 5, 12, 30};
  status.tiles = {400, 10};
  MapInfo map;
  map.id = "yard";
  map.version = {7, 20};
  map.num_submaps = 2;
  map.num_points = 10'000;
  map.submap_bytes = 3 << 20;
  map.num_tiles = 9;
  sample.maps.push_back(map);
  return sample;
}

/// Two seconds later.
TopSample Now() {
  TopSample sample = Before();
  ServerStatus& status = sample.status;
  status.uptime_s = 12;
  status.sessions[0].num_scans_fused += 20;
  status.sessions[0].num_scans_refused += 1;
  status.sessions[0].queue_bytes = 1536 << 10;
  status.sessions[0].oldest_s = 0.25;
  status.timings[0] = {"local", "fuse", 120, 0.56, 0.08, {{0.001, 50}, {0.01, 110}, {kInf, 120}}};
  status.timings[1] = {"service", "scan", 120, 4, 0.3, {{0.1, 110}, {kInf, 120}}};
  status.calls[0] = {"BatchGetTiles", 70, 3, 2, 1400, 3'000'000, 0.12, {{0.005, 68}, {kInf, 68}}};
  status.lags[0] = {"yard", 2.5, 0.1, 3};
  status.process = {110 << 20, 8, 13, 31};
  status.tiles = {600, 14};
  sample.maps[0].version.revision = 24;
  sample.maps[0].num_points = 9'000;
  return sample;
}

TopRates Rates() { return RatesBetween(Before(), Now()); }

TEST(TopRates, DividesWhatGrewByTheServersTime) {
  const TopRates rates = Rates();
  EXPECT_DOUBLE_EQ(rates.interval_s, 2);
  EXPECT_DOUBLE_EQ(rates.cpu_cores, 1.5);
  EXPECT_DOUBLE_EQ(rates.tiles_hz, 100);
  EXPECT_DOUBLE_EQ(rates.absent_tiles_hz, 2);
  ASSERT_EQ(rates.robots.size(), 1u);
  EXPECT_DOUBLE_EQ(rates.robots[0].scans_hz, 10);
  EXPECT_DOUBLE_EQ(rates.robots[0].refused_hz, 0.5);
  EXPECT_DOUBLE_EQ(rates.robots[0].lag_s, 0.25);
  ASSERT_EQ(rates.maps.size(), 1u);
  EXPECT_DOUBLE_EQ(rates.maps[0].revisions_hz, 2);
  EXPECT_DOUBLE_EQ(rates.maps[0].points_hz, -500);  // a merge
  EXPECT_DOUBLE_EQ(rates.maps[0].staleness_s, 2.5);
  EXPECT_EQ(rates.maps[0].num_corrections_waiting, 3u);
}

TEST(TopRates, TimesAreThoseOfTheInterval) {
  const TopRates rates = Rates();
  ASSERT_EQ(rates.stages.size(), 2u);
  const TimesMs& fuse = rates.stages[0].times;
  EXPECT_NEAR(fuse.mean, 3, 1e-9);  // 60 ms for 20 runs
  // 10 of 20 runs took up to 1 ms, 10 from 1 to 10 ms.
  EXPECT_NEAR(fuse.p50, 1, 1e-9);
  EXPECT_NEAR(fuse.p99, 1 + 9 * 0.98, 1e-9);
  EXPECT_NEAR(fuse.max, 10, 1e-9);  // no longer than its bucket; 80 ms was before
  const TimesMs& scan = rates.stages[1].times;
  EXPECT_NEAR(scan.max, 300, 1e-9);   // the longest since the start is new
  EXPECT_NEAR(scan.p99, 100, 1e-9);   // beyond the last edge nothing is known
  ASSERT_EQ(rates.calls.size(), 1u);  // GetMap was never called
  EXPECT_DOUBLE_EQ(rates.calls[0].calls_hz, 10);
  EXPECT_DOUBLE_EQ(rates.calls[0].failed_hz, 1);
  EXPECT_DOUBLE_EQ(rates.calls[0].sent_bytes_hz, 1e6);
  EXPECT_NEAR(rates.calls[0].times.mean, 0.02 / 18 * 1e3, 1e-9);
}

TEST(TopRates, WhatDidNotRunHasNoTimes) {
  const TopRates rates = RatesBetween(Now(), Now());
  EXPECT_TRUE(std::isnan(rates.stages[0].times.mean));
  EXPECT_TRUE(std::isnan(rates.stages[0].times.p99));
  EXPECT_TRUE(std::isnan(rates.stages[0].times.max));
  EXPECT_EQ(rates.stages[0].runs_hz, 0);
}

TEST(TopRates, ARestartedServerCountsFromItsStart) {
  TopSample before = Before();
  before.status.uptime_s = 1e6;
  before.status.sessions[0].num_scans_fused = 1'000'000;
  before.maps[0].version = {6, 5};
  const TopRates rates = RatesBetween(before, Now());
  EXPECT_DOUBLE_EQ(rates.interval_s, 12);
  EXPECT_DOUBLE_EQ(rates.robots[0].scans_hz, 10);
  EXPECT_DOUBLE_EQ(rates.maps[0].revisions_hz, 2);
}

TEST(TopRates, EndedSessionsAreOnlyCounted) {
  TopSample now = Now();
  now.status.sessions[0].active = false;
  const TopRates rates = RatesBetween(Before(), now);
  EXPECT_TRUE(rates.robots.empty());
  EXPECT_EQ(rates.num_ended_sessions, 1u);
}

std::vector<std::string> Lines(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream stream(text);
  for (std::string line; std::getline(stream, line);) lines.push_back(line);
  return lines;
}

TEST(TopScreen, ShowsEverythingAsPlainText) {
  EXPECT_EQ(
      TopScreen(Rates(), {{100, 0}, false, "127.0.0.1:50051", ""}),
      R"( gem_server 0.1.0  127.0.0.1:50051  cpu  up 12 s                                        last 2.00 s
 cpu 1.50 cores  memory 110 MiB  13 threads  31 files  tiles 100/s, absent 2.00/s
 sessions 1 streaming, 0 without a stream, 0 ended

ROBOT     map       session   state      scans/s  refused/s     queue      lag
rover     yard      s1        streaming     10.0       0.50  1.50 MiB   250 ms

MAP       submaps   points  points/s    tiles    memory  revision    rev/s   behind  corrections
yard            2     9000      -500        9  3.00 MiB        24     2.00   2.50 s            3

STAGE          runs/s  mean ms  ~p50 ms  ~p99 ms   max ms
local fuse       10.0     3.00     1.00     9.82     10.0
service scan     10.0      150      100      100      300

CALL           calls/s  failed/s   active  mean ms  ~p99 ms     in/s    out/s
BatchGetTiles     10.0      1.00        2     1.11     4.95    200 B  977 KiB
)");
}

TEST(TopScreen, FitsEverySize) {
  TopSample now = Now();
  for (int i = 0; i < 40; ++i) {
    SessionStatus robot = now.status.sessions[0];
    robot.robot = "robot_" + std::string(60, 'x');
    robot.session = std::to_string(i);
    now.status.sessions.push_back(robot);
  }
  const TopRates rates = RatesBetween(Before(), now);
  for (const int columns : {1, 20, 80, 143, 144, 250})
    for (const int rows : {1, 2, 5, 24, 60}) {
      const auto lines = Lines(TopScreen(rates, {{columns, rows}, false, "host:1", "lost"}));
      EXPECT_LE(lines.size(), static_cast<std::size_t>(rows)) << columns << " x " << rows;
      for (const std::string& line : lines)
        EXPECT_LE(line.size(), static_cast<std::size_t>(columns)) << columns << " x " << rows;
      EXPECT_EQ(lines.back(), std::string("lost").substr(0, static_cast<std::size_t>(columns)));
    }
}

TEST(TopScreen, SaysHowMuchDidNotFit) {
  TopSample now = Now();
  for (int i = 0; i < 40; ++i) now.status.sessions.push_back(now.status.sessions[0]);
  const std::string text = TopScreen(RatesBetween(Before(), now), {{100, 30}, false, "", ""});
  EXPECT_THAT(text, HasSubstr("41 streaming"));
  // 30 rows less 3 of the head, less 2 for each of 4 tables, less 4 rows of the others: 15, the
  // last of which counts the rest.
  EXPECT_THAT(text, HasSubstr("... 27 more\n"));
  EXPECT_THAT(text, HasSubstr("BatchGetTiles"));
}

TEST(TopScreen, WideTerminalsShowStagesAndCallsBesideEachOther) {
  const auto lines = Lines(TopScreen(Rates(), {{144, 40}, false, "", ""}));
  EXPECT_THAT(lines, testing::Contains(testing::AllOf(HasSubstr("STAGE"), HasSubstr("CALL"))));
}

TEST(TopScreen, ColoursWhatIsWrongAndNothingIfThereAreNoColours) {
  const std::string bad = "\x1b[1;31m";
  const std::string colored = TopScreen(Rates(), {{100, 40}, true, "", ""});
  EXPECT_THAT(colored, HasSubstr(bad + " 250 ms"));
  EXPECT_THAT(colored, HasSubstr(bad + "     0.50"));
  EXPECT_THAT(TopScreen(RatesBetween(Before(), Before()), {{100, 40}, true, "", ""}),
              Not(HasSubstr(bad)));
  EXPECT_THAT(TopScreen(Rates(), {{100, 40}, false, "", ""}), Not(HasSubstr("\x1b")));
}

TEST(TopScreen, AnEmptyServerIsShownToo) {
  const std::string text = TopScreen(RatesBetween({}, {}), {{80, 24}, false, "", ""});
  EXPECT_THAT(text, HasSubstr("sessions 0 streaming"));
  EXPECT_THAT(text, Not(HasSubstr("nan")));
}

TEST(TopJson, IsOneLineWithTheSameNumbers) {
  const std::string json = TopJson(Rates());
  EXPECT_EQ(Lines(json).size(), 1u);
  EXPECT_THAT(json, HasSubstr("\"interval_s\":2,"));
  EXPECT_THAT(json, HasSubstr("{\"map\":\"yard\",\"robot\":\"rover\",\"session\":\"s1\","
                              "\"connected\":true,\"scans_hz\":10,\"refused_hz\":0.5,"
                              "\"queue_bytes\":1572864,\"lag_s\":0.25}"));
  EXPECT_THAT(json, HasSubstr("\"ms\":{\"mean\":3,\"p50\":1,\"p99\":9.82,\"max\":10}"));
  // Nothing ran: null, which every reader of JSON takes.
  EXPECT_THAT(TopJson(RatesBetween(Now(), Now())), HasSubstr("\"mean\":null"));
}

}  // namespace
}  // namespace gem::client
