#include "client/load/growth.h"

#include <gtest/gtest.h>

#include <random>

namespace gem::load {
namespace {

TEST(Growth, OfALineIsItsRise) {
  const Growth growth = GrowthOf({10, 12, 14, 16});
  EXPECT_DOUBLE_EQ(growth.growth, 6);
  EXPECT_DOUBLE_EQ(growth.median, 13);
  EXPECT_DOUBLE_EQ(growth.max, 16);
}

TEST(Growth, OfNothingIsNothing) {
  EXPECT_EQ(GrowthOf({}).growth, 0);
  EXPECT_EQ(GrowthOf({7}).growth, 0);
  EXPECT_EQ(GrowthOf({7, 7, 7}).growth, 0);
}

TEST(Growth, ABurstIsNone) {
  std::vector<double> samples(100, 50);
  for (std::size_t i = 60; i < 80; ++i) samples[i] = 5000;
  EXPECT_EQ(GrowthOf(samples).growth, 0);
  EXPECT_EQ(GrowthOf(samples).max, 5000);
}

TEST(Growth, ALeakUnderNoiseIsFound) {
  std::mt19937 random(3);
  std::vector<double> samples;
  for (int i = 0; i < 300; ++i)
    samples.push_back(1000 + i * 0.2 + static_cast<double>(random() % 40));
  EXPECT_NEAR(GrowthOf(samples).growth, 60, 8);
}

}  // namespace
}  // namespace gem::load
