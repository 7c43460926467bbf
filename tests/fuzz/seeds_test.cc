// The seeds, inputs that once did harm, and many small damages of each seed, through every fuzzer's
// function: what a fuzzer would find in its first second is found by every test run. A failure ends
// the process.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>

#include "tests/fuzz/targets.h"

namespace gem::fuzz {
namespace {

constexpr std::size_t kSeedBytesMax = 8192;

class Seeds : public testing::TestWithParam<Target> {
 protected:
  static void Feed(const std::string& bytes) {
    GetParam().run(reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size());
  }
};

std::string Damaged(std::string bytes, std::mt19937& random) {
  const auto below = [&](std::size_t limit) { return random() % std::max<std::size_t>(limit, 1); };
  for (std::size_t damages = 1 + below(3); damages > 0 && !bytes.empty(); --damages) {
    const std::size_t at = below(bytes.size());
    switch (below(4)) {
      case 0:
        bytes[at] = static_cast<char>(random());
        break;
      case 1:
        bytes[at] = static_cast<char>(bytes[at] ^ (1 << below(8)));
        break;
      case 2:
        bytes.resize(at);
        break;
      default:
        bytes.insert(at, bytes.substr(below(bytes.size()), 1 + below(8)));
    }
  }
  return bytes;
}

TEST_P(Seeds, AreSmall) {
  ASSERT_FALSE(GetParam().seeds().empty());
  for (const std::string& seed : GetParam().seeds()) EXPECT_LT(seed.size(), kSeedBytesMax);
}

TEST_P(Seeds, SurviveDamage) {
  std::mt19937 random(20261122);
  for (const std::string& seed : GetParam().seeds()) {
    Feed(seed);
    for (int i = 0; i < GetParam().damages_each; ++i) Feed(Damaged(seed, random));
  }
}

TEST_P(Seeds, AreNotNeeded) {
  Feed("");
  std::mt19937 random(1);
  for (int i = 0; i < GetParam().damages_each / 5; ++i) {
    std::string noise(random() % 64, '\0');
    for (char& c : noise) c = static_cast<char>(random());
    Feed(noise);
  }
}

TEST_P(Seeds, WhatOnceDidHarmDoesNoMore) {
  const std::filesystem::path folder =
      std::filesystem::path(GEM_SOURCE_DIR) / "tests/fuzz/crashes" / GetParam().name;
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator(folder, error)) {
    SCOPED_TRACE(entry.path());
    std::ifstream file(entry.path(), std::ios::binary);
    Feed({std::istreambuf_iterator<char>(file), {}});
  }
}

INSTANTIATE_TEST_SUITE_P(EveryTarget, Seeds, testing::ValuesIn(Targets()),
                         [](const auto& target) { return target.param.name; });

}  // namespace
}  // namespace gem::fuzz
