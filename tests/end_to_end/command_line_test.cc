// What a user sees who mistypes, and what a stopped server leaves behind.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <string>

#include "tests/end_to_end/process.h"

namespace gem::test {
namespace {

using testing::HasSubstr;

TEST(CommandLine, SaysWhichSceneIsUnknownAndWhichThereAre) {
  const Finished run = Gem({"simulate", "moon", "--server", "127.0.0.1:1"});
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_THAT(run.output, HasSubstr("moon"));
  EXPECT_THAT(run.output, HasSubstr("block"));
}

TEST(CommandLine, SaysWhichFileIsMissing) {
  const ScratchDir scratch;
  const Finished run = Gem({"replay", "kitti", scratch.File("nowhere"), "--server", "127.0.0.1:1"});
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_THAT(run.output, HasSubstr("nowhere"));
}

TEST(CommandLine, SaysWhichMapIsUnknown) {
  const ServerProcess server;
  const ScratchDir scratch;
  const Finished run = Gem({"export", "--server", server.address(), "--map", "atlantis", "--layer",
                            "elevation", "--format", "xyz", "--out", scratch.File("out.xyz")});
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_THAT(run.output, HasSubstr("atlantis"));
  EXPECT_FALSE(std::ifstream(scratch.File("out.xyz")).good()) << "a failed export left a file";
}

TEST(CommandLine, StatusSpeaksJson) {
  const ServerProcess server;
  const Finished run = Gem({"status", "--server", server.address(), "--json"});
  EXPECT_EQ(run.exit_code, 0) << run.output;
  EXPECT_THAT(run.output, HasSubstr("\"maps\""));
}

TEST(CommandLine, TopPrintsOneFrameIntoAPipe) {
  const ServerProcess server;
  const Finished text = Gem({"top", "--server", server.address(), "--once", "--interval_s", "0.1"});
  EXPECT_EQ(text.exit_code, 0) << text.output;
  EXPECT_THAT(text.output, HasSubstr("sessions 0 streaming"));
  EXPECT_THAT(text.output, HasSubstr("GetServerStatus"));
  EXPECT_THAT(text.output, testing::Not(HasSubstr("\x1b")));
  const Finished json =
      Gem({"top", "--server", server.address(), "--once", "--json", "--interval_s", "0.1"});
  EXPECT_EQ(json.exit_code, 0) << json.output;
  EXPECT_THAT(json.output, HasSubstr("\"interval_s\""));
}

TEST(CommandLine, TopSaysThatNobodyAnswers) {
  const Finished run = Gem({"top", "--server", "127.0.0.1:1", "--once"});
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_THAT(run.output, HasSubstr("127.0.0.1:1"));
}

// Requirement: while a map is corrected again and again beside a streaming robot, renderings are
// stopped and restarted; the map that is published last must be the last correction's, cell for
// cell. The bench compares, and fails if it is not.
TEST(CommandLine, BenchCorrectionsEndsWithTheMapOfTheLastCorrection) {
  const Finished run = Gem({"bench", "corrections", "--way_m", "60", "--seconds", "1", "--block_s",
                            "0.5", "--hz", "50", "--json"});
  EXPECT_EQ(run.exit_code, 0) << run.output;
  EXPECT_THAT(run.output, HasSubstr("\"different_cells\":0"));
  EXPECT_THAT(run.output, testing::Not(HasSubstr("\"cells\":0,")));
  EXPECT_THAT(run.output, testing::Not(HasSubstr("\"corrections\":0,")));
}

// Scripts branch on the exit code: 0 free, 1 not free, 2 nobody knows.
TEST(CommandLine, CheckPathTellsFreeFromNotFreeByItsExitCode) {
  const ServerProcess server;
  const Finished drive =
      Gem({"simulate", "flat", "--server", server.address(), "--map", "yard", "--robot", "r1",
           "--scans", "40", "--rings", "64", "--cell_size_m", "0.4"});
  ASSERT_EQ(drive.exit_code, 0) << drive.output;
  const auto check = [&](const std::vector<std::string>& more) {
    std::vector<std::string> arguments = {
        "check-path", "--server", server.address(), "--map", "yard", "--path", "3,0", "5,1"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return Gem(arguments);
  };
  Finished run = check({"--radius_m", "0.3"});
  EXPECT_EQ(run.exit_code, 0) << run.output;
  EXPECT_THAT(run.output, HasSubstr("free: 2.24 m"));
  run = check({"500,0", "--rectangle", "-0.5,-0.3,0.5,0.3", "--json"});
  EXPECT_EQ(run.exit_code, 1) << run.output;
  EXPECT_THAT(run.output, HasSubstr("\"free\":false"));
  run = check({"--radius_m", "11"});
  EXPECT_EQ(run.exit_code, 2) << run.output;
  EXPECT_THAT(run.output, HasSubstr("footprint.radius_m is 11, want 0 to 10"));
  EXPECT_EQ(check({}).exit_code, 2) << "a robot without a shape";
  run = Gem({"sample", "--server", server.address(), "--map", "yard", "-500,0", "4,-1"});
  EXPECT_EQ(run.exit_code, 0) << run.output;
  EXPECT_THAT(run.output, HasSubstr("4,-1: free, height "));
  EXPECT_THAT(run.output, HasSubstr("-500,0: unknown"));
}

TEST(Server, RefusesAConfigurationWithAnUnknownKeyAndNamesTheLine) {
  const ScratchDir scratch;
  std::ofstream(scratch.File("gem.yaml")) << "map:\n  cell_size_m: 0.1\n  cell_sise_m: 0.2\n";
  const Finished run = RunProgram({GEM_SERVER_BINARY, "--config", scratch.File("gem.yaml")}, 30);
  EXPECT_NE(run.exit_code, 0);
  EXPECT_THAT(run.output, HasSubstr("gem.yaml:3"));
  EXPECT_THAT(run.output, HasSubstr("cell_sise_m"));
}

TEST(Server, SaysThatItsPortIsTaken) {
  const ServerProcess server;
  const Finished run = RunProgram(
      {GEM_SERVER_BINARY, "--listen", server.address(), "--metrics_listen", "127.0.0.1:0"}, 30);
  EXPECT_NE(run.exit_code, 0);
  EXPECT_THAT(run.output, HasSubstr(server.address()));
}

TEST(Server, StopsCleanlyAtOnce) {
  ServerProcess server;
  double seconds = 0;
  EXPECT_EQ(server.Stop(seconds), 0);
  EXPECT_LT(seconds, 2.0) << "a promise of the server, not a benchmark";
}

}  // namespace
}  // namespace gem::test
