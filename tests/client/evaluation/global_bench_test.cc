#include "client/evaluation/global_bench.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace gem::evaluation {
namespace {

TEST(GlobalBench, BuildsTheMapItSaysAndMovesAllOfIt) {
  const GlobalBenchOptions options{.way_m = 200, .width_m = 4, .num_corrections = 2};
  const auto bench = BenchGlobal(options);
  ASSERT_TRUE(bench.ok()) << bench.status();
  // A strip of 200 m x 4 m in cells of 0.2 m.
  EXPECT_NEAR(static_cast<double>(bench->num_points), 200 * 4 * 25, 200 * 25);
  EXPECT_NEAR(static_cast<double>(bench->num_submaps), 20, 2);
  EXPECT_GE(bench->num_touched_tiles, 8u);
  EXPECT_LT(bench->num_touched_tiles_of_tenth, bench->num_touched_tiles);
  EXPECT_GT(bench->correction.median, 0);
  EXPECT_GT(bench->known_cells_per_s, 0);
}

TEST(GlobalBench, NamesWhatIsOutOfRange) {
  EXPECT_THAT(BenchGlobal({.way_m = 1}).status().message(), testing::HasSubstr("way_m is 1"));
}

}  // namespace
}  // namespace gem::evaluation
