#include "client/load/soak.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace gem::load {
namespace {

using ::testing::HasSubstr;

SoakReport Calm() {
  SoakReport report;
  report.num_samples = 400;
  report.growth = {{200 << 20, 250 << 20, 1 << 20}, {20, 30, 0}, {40, 60, -1}};
  return report;
}

TEST(JudgeSoak, LetsWhatDoesNotGrowPass) { EXPECT_TRUE(JudgeSoak(Calm()).ok()); }

TEST(JudgeSoak, SeesEachThingThatGrows) {
  SoakReport report = Calm();
  report.growth.resident_bytes.growth = 12 << 20;
  EXPECT_THAT(std::string(JudgeSoak(report).message()), HasSubstr("resident memory"));
  report = Calm();
  report.growth.threads.growth = 4;
  EXPECT_THAT(std::string(JudgeSoak(report).message()), HasSubstr("threads grew by 4.0"));
  report = Calm();
  report.growth.open_files.growth = 4;
  EXPECT_THAT(std::string(JudgeSoak(report).message()), HasSubstr("open files"));
}

TEST(JudgeSoak, SeesAServerThatDied) {
  SoakReport report = Calm();
  report.exit_code = -11;
  EXPECT_THAT(std::string(JudgeSoak(report).message()), HasSubstr("ended with -11"));
}

TEST(JudgeSoak, WantsEnoughSamples) {
  SoakReport report = Calm();
  report.num_samples = 3;
  EXPECT_FALSE(JudgeSoak(report).ok());
}

}  // namespace
}  // namespace gem::load
