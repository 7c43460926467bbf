// gem watch against the shipped server: lines that a program can read while the map changes.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <future>
#include <regex>
#include <string>
#include <vector>

#include "tests/end_to_end/process.h"

namespace gem::test {
namespace {

using testing::HasSubstr;

void DriveABit(const ServerProcess& server) {
  const Finished run = Gem({"simulate", "block", "--server", server.address(), "--map", "site",
                            "--robot", "r1", "--scans", "3"});
  ASSERT_EQ(run.exit_code, 0) << run.output;
}

TEST(Watch, PrintsOneLineAVersionWhileTheMapGrows) {
  const ServerProcess server;
  auto watched = std::async(std::launch::async, [&] {
    return Gem(
        {"watch", "--server", server.address(), "--map", "site", "--json", "--versions", "3"});
  });
  // It begins before there is a map. Every session leaves a new version, until it has seen enough.
  while (watched.wait_for(std::chrono::seconds(0)) != std::future_status::ready) DriveABit(server);
  const Finished watch = watched.get();
  ASSERT_EQ(watch.exit_code, 0) << watch.output;
  static const std::regex kLine(
      R"(\{"epoch":(\d+),"revision":(\d+),"level":0,"num_tiles":(\d+),"num_changed":(\d+)\}\n)");
  const auto begin = std::sregex_iterator(watch.output.begin(), watch.output.end(), kLine);
  const std::vector<std::smatch> lines(begin, std::sregex_iterator());
  ASSERT_EQ(lines.size(), 3u) << watch.output;
  for (std::size_t i = 1; i < lines.size(); ++i) {
    EXPECT_EQ(lines[i][1], lines[0][1]);
    EXPECT_GT(std::stoull(lines[i][2]), std::stoull(lines[i - 1][2]));
  }
  EXPECT_GT(std::stoi(lines.back()[3]), 0);
}

TEST(Watch, TellsPeopleWhatTheMapHolds) {
  const ServerProcess server;
  DriveABit(server);
  const Finished watch = Gem({"watch", "--server", server.address(), "--map", "site", "--region",
                              "-1000,-1000,1000,1000", "--level", "2", "--versions", "1"});
  EXPECT_EQ(watch.exit_code, 0);
  EXPECT_TRUE(std::regex_match(watch.output,
                               std::regex(R"(version \d+\.\d+: ([1-9]\d*) tiles, \1 changed\n)")))
      << watch.output;
}

TEST(Watch, EndsWithWhatWaitingCannotMend) {
  const ServerProcess server;
  DriveABit(server);
  const Finished watch =
      Gem({"watch", "--server", server.address(), "--map", "site", "--region", "5,0,1,1"});
  EXPECT_EQ(watch.exit_code, 1);
  EXPECT_THAT(watch.output, HasSubstr("region"));
}

}  // namespace
}  // namespace gem::test
