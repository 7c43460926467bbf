// What README.md shows to planners is what is compiled, and it works.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <future>
#include <iterator>
#include <string>

#include "tests/end_to_end/process.h"

namespace gem::test {
namespace {

std::string TextOf(const std::string& file) {
  std::ifstream in(GEM_SOURCE_DIR "/" + file);
  return {std::istreambuf_iterator<char>(in), {}};
}

TEST(Example, IsWhatTheReadmeShows) {
  const std::string code = TextOf("client/examples/wait_for_ground.cc");
  ASSERT_FALSE(code.empty());
  EXPECT_THAT(TextOf("README.md"), testing::HasSubstr("```cpp\n" + code + "```\n"));
}

TEST(Example, WaitsUntilTheGroundIsKnown) {
  const ServerProcess server;
  auto waits = std::async(std::launch::async, [&] {
    return RunProgram({GEM_EXAMPLE_BINARY, server.address(), "site", "21.9", "3.1"});
  });
  // There is no map yet.
  const Finished drive = Gem({"simulate", "block", "--server", server.address(), "--map", "site",
                              "--robot", "r1", "--scans", "30"});
  ASSERT_EQ(drive.exit_code, 0) << drive.output;
  const Finished example = waits.get();
  EXPECT_EQ(example.exit_code, 0) << example.output;
  EXPECT_THAT(example.output, testing::MatchesRegex("-?[0-9.]+ m, (not )?free\n"));
}

}  // namespace
}  // namespace gem::test
