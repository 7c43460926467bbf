// The seeds, and many small damages of each, through the fuzzers' entry functions: what a fuzzer
// would find in its first second is found by every test run. A failure ends the process.
#include <gtest/gtest.h>

#include <random>

#include "gem/v1/ingest_service.pb.h"
#include "gem/v1/types.pb.h"
#include "tests/fuzz/fuzz_targets.h"

namespace gem::fuzz {
namespace {

using Target = void (*)(const std::uint8_t*, std::size_t);

void Feed(Target target, const std::string& bytes) {
  target(reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size());
}

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

void FeedDamaged(Target target, const std::vector<std::string>& seeds, int damages_each) {
  std::mt19937 random(20261122);
  for (const std::string& seed : seeds) {
    Feed(target, seed);
    for (int i = 0; i < damages_each; ++i) Feed(target, Damaged(seed, random));
  }
}

TEST(FuzzSeeds, IngestRequestsSurviveDamage) {
  FeedDamaged(IngestRequest, IngestRequestSeeds(), 5000);
}

TEST(FuzzSeeds, TilesSurviveDamage) { FeedDamaged(Tile, TileSeeds(), 2000); }

TEST(FuzzSeeds, NothingAndNoiseAreSurvived) {
  Feed(IngestRequest, "");
  Feed(Tile, "");
  std::mt19937 random(1);
  for (int i = 0; i < 1000; ++i) {
    std::string noise(random() % 64, '\0');
    for (char& c : noise) c = static_cast<char>(random());
    Feed(IngestRequest, noise);
    Feed(Tile, noise);
  }
}

TEST(FuzzSeeds, AreGoodMessages) {
  for (const std::string& seed : IngestRequestSeeds()) {
    v1::IngestRequest request;
    EXPECT_TRUE(request.ParseFromString(seed));
    EXPECT_NE(request.payload_case(), v1::IngestRequest::PAYLOAD_NOT_SET);
    EXPECT_LT(seed.size(), 1000u);
  }
  for (const std::string& seed : TileSeeds()) {
    v1::Tile tile;
    EXPECT_TRUE(tile.ParseFromString(seed));
    EXPECT_LT(seed.size(), 2000u);
  }
}

}  // namespace
}  // namespace gem::fuzz
