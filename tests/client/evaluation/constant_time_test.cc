#include "client/evaluation/constant_time.h"

#include <gtest/gtest.h>

namespace gem::evaluation {
namespace {

TEST(MedianOf, IsTheMiddleOfAPart) {
  const std::vector<double> values = {9, 1, 5, 7, 3};
  EXPECT_EQ(MedianOf(values, 0, 5), 5);
  EXPECT_EQ(MedianOf(values, 1, 3), 5);
  EXPECT_EQ(MedianOf(values, 3, 100), 7) << "the upper one of two, and no further than the end";
  EXPECT_EQ(MedianOf(values, 5, 10), 0);
}

// Small enough for a test, and without recordings.
TEST(RunConstantTime, SaysWhatAScanCostsInFourMaps) {
  Settings settings;
  settings.scale = 0.01;
  const absl::StatusOr<Report> report = RunConstantTime(settings);
  ASSERT_TRUE(report.ok()) << report.status();
  ASSERT_EQ(report->tables.size(), 2u);
  EXPECT_EQ(report->tables.front().rows.size(), 4u);
  EXPECT_EQ(report->plots.size(), 4u);
  EXPECT_EQ(report->skipped.size(), 1u);
  for (const Plot& plot : report->plots)
    for (const Series& series : plot.series) {
      ASSERT_FALSE(series.y.empty());
      EXPECT_EQ(series.x.size(), series.y.size());
      EXPECT_GT(series.y.back(), 0);
    }
}

}  // namespace
}  // namespace gem::evaluation
