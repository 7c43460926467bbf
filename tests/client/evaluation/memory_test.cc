#include "client/evaluation/memory.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace gem::evaluation {
namespace {

TEST(RunMemory, FindsThatMaintenanceKeepsTheMapSmall) {
  Settings settings;
  settings.scale = 0.1;
  const absl::StatusOr<Report> report = RunMemory(settings);
  ASSERT_TRUE(report.ok()) << report.status();
  const auto figure = [&report](const std::string& name) {
    const auto found =
        std::find_if(report->figures.begin(), report->figures.end(),
                     [&name](const Figure& f) { return f.name.rfind(name, 0) == 0; });
    return found == report->figures.end() ? -1 : found->value;
  };
  EXPECT_GT(figure("bytes per stored point"), 30);
  EXPECT_LE(figure("bytes per stored point"), 40);
  // 600 scans are two rounds and a half.
  EXPECT_LT(figure("round one block, points in"), 20);
  EXPECT_LT(figure("round one block, stored points per cell"), 1.2);
  EXPECT_GT(figure("the same without maintenance"), 2);
}

}  // namespace
}  // namespace gem::evaluation
