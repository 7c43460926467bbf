#include "client/evaluation/timing.h"

#include <gtest/gtest.h>

namespace gem::evaluation {
namespace {

TEST(PaperSteps, CountMovingAndMeasuringAsMapBuilding) {
  LocalBench bench;
  bench.move.median = 1;
  bench.measure.median = 2;
  bench.fuse.median = 4;
  bench.annotate.median = 8;
  bench.clear.median = 16;
  bench.total.median = 30;
  const PaperSteps_ms steps = PaperStepsOf(bench);
  EXPECT_EQ(steps.build, 7);
  EXPECT_EQ(steps.annotate, 8);
  EXPECT_EQ(steps.clear, 16);
  EXPECT_EQ(steps.total, 30);
}

TEST(RunTiming, TimesASimulatedStreetWithoutData) {
  Settings settings;
  settings.scale = 0.05;
  const auto report = RunTiming(settings);
  ASSERT_TRUE(report.ok()) << report.status();
  EXPECT_EQ(report->skipped.size(), 1u);
  ASSERT_EQ(report->tables.size(), 2u);
  EXPECT_EQ(report->tables[0].columns.size(), 6u);
  EXPECT_EQ(report->tables[1].rows.size(), 5u);
  for (const Table& table : report->tables)
    for (const auto& row : table.rows) EXPECT_EQ(row.size(), table.columns.size());
  for (const Figure& figure : report->figures) EXPECT_GT(figure.value, 0) << figure.name;
}

}  // namespace
}  // namespace gem::evaluation
