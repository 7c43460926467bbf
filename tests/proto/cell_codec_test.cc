#include "proto/wire/cell_codec.h"

#include <gtest/gtest.h>

#include <limits>
#include <random>

namespace gem::wire {
namespace {

using Cells = std::vector<std::int16_t>;
using Valid = std::vector<std::uint8_t>;

std::string Bytes(std::initializer_list<int> bytes) {
  std::string result;
  for (const int byte : bytes) result.push_back(static_cast<char>(byte));
  return result;
}

std::string Encode(const Cells& cells, const Valid& valid, std::size_t columns) {
  return EncodeCells(std::span<const std::int16_t>(cells), {valid, columns});
}

TEST(EncodeCells, BeginsAtZeroAndGoesOnFromTheLeft) {
  // Differences 5, -1, 1, 0 as 10, 1, 2, 0.
  EXPECT_EQ(Encode({5, 4, 5, 5}, {1, 1, 1, 1}, 4), Bytes({10, 1, 2, 0, 0, 0, 0, 0}));
}

TEST(EncodeCells, PutsAllLowBytesBeforeAllHighBytes) {
  // 300 is 600 = 0x258, then -300 is 599 = 0x257.
  EXPECT_EQ(Encode({300, 0}, {1, 1}, 2), Bytes({0x58, 0x57, 2, 2}));
}

TEST(EncodeCells, FollowsAPlane) {
  // Up 2 a column, down 3 a row: first column from below, -3 is 5, the rest as foretold.
  EXPECT_EQ(Encode({10, 12, 14, 7, 9, 11}, {1, 1, 1, 1, 1, 1}, 3),
            Bytes({20, 4, 4, 5, 0, 0, 0, 0, 0, 0, 0, 0}));
  // Up 2 a column, up 3 a row: never beyond the higher neighbour. 15 - 13 and 17 - 15, as 4.
  EXPECT_EQ(Encode({10, 12, 14, 13, 15, 17}, {1, 1, 1, 1, 1, 1}, 3),
            Bytes({20, 4, 4, 6, 4, 4, 0, 0, 0, 0, 0, 0}));
}

TEST(EncodeCells, StopsAtAnEdge) {
  // Left 0, lower 100, corner 0: left + lower - corner = 100, the lower one. Left 0, lower 100,
  // corner 100: 0, the left one.
  EXPECT_EQ(Encode({0, 100, 0, 100}, {1, 1, 1, 1}, 2)[3], 0);
  EXPECT_EQ(Encode({100, 100, 0, 0}, {1, 1, 1, 1}, 2)[3], 0);
}

TEST(EncodeCells, GivesCellsThatAreNotValidNoBytes) {
  EXPECT_EQ(Encode({7, 99, 7, 99}, {1, 0, 1, 0}, 4), Bytes({14, 0, 0, 0}))
      << "a gap is bridged by the last valid cell";
  EXPECT_EQ(Encode({1, 2, 3, 4}, {0, 0, 0, 0}, 2), "");
}

TEST(EncodeCells, ForetellsFromTheNeighboursThatThereAre) {
  // Upper row, middle cell, value 0; what is foretold is 10 below, 20 left, 40 corner, 80 right.
  const auto foretold = [](const Valid& valid) {
    // Lower row: corner, below, lower right; upper row: left, itself.
    const Cells cells = {40, 10, 80, 20, 0, 0};
    Valid mask = valid;
    mask.push_back(1);
    mask.push_back(0);
    const std::string data = Encode(cells, mask, 3);
    const std::size_t num_valid = data.size() / 2;
    const auto code = static_cast<std::uint8_t>(data[num_valid - 1]);
    return (code + 1) / 2;  // of a negative difference
  };
  EXPECT_EQ(foretold({1, 1, 1, 1}), 10) << "median of 20, 10 and -10";
  EXPECT_EQ(foretold({0, 1, 1, 1}), 15) << "without the corner the mean";
  EXPECT_EQ(foretold({1, 0, 1, 1}), 20) << "left";
  EXPECT_EQ(foretold({1, 1, 1, 0}), 10) << "below";
  EXPECT_EQ(foretold({1, 0, 1, 0}), 40) << "corner";
  EXPECT_EQ(foretold({0, 0, 1, 0}), 80) << "lower right";
}

TEST(EncodeCells, FallsBackToTheLastValidCell) {
  // The cell at the right of the upper row has no neighbour that is valid.
  EXPECT_EQ(Encode({9, 0, 0, 0, 0, 8}, {1, 0, 0, 0, 0, 1}, 3), Bytes({18, 1, 0, 0}));
}

TEST(EncodeCells, RoundsTheMeanDownAlsoBelowZero) {
  // Left 0 and below -3 without a corner: -2, so 0 is +2.
  EXPECT_EQ(Encode({0, -3, 0, 0}, {0, 1, 1, 1}, 2)[2], 4);
}

TEST(EncodeCells, DoesNotLookAcrossTheBorder) {
  // The first cell of the upper row: its left neighbour in memory is the end of the lower row.
  EXPECT_EQ(Encode({1, 50, 1, 50}, {1, 1, 1, 1}, 2)[2], 0);
  // The last cell of the upper row has no lower right neighbour: 7 is the last valid cell.
  EXPECT_EQ(Encode({0, 0, 7, 0, 0, 7, 0, 0, 0}, {0, 0, 1, 0, 0, 1, 0, 0, 0}, 3),
            Bytes({14, 0, 0, 0}));
}

TEST(EncodeCells, WrapsAround) {
  // From 32767 to -32768: the difference -65535 is 1 modulo 65536, so 2.
  const Cells cells = {32767, -32768, 32767};
  const Valid valid = {1, 1, 1};
  const std::string data = Encode(cells, valid, 3);
  EXPECT_EQ(data, Bytes({0xfe, 2, 1, 0xff, 0, 0}));
  EXPECT_EQ(DecodeCells(data, {valid, 3}), cells);
}

TEST(EncodeCells, TakesColoursChannelByChannel) {
  // Red 1, 2; green 255, 0, which is +1; blue 16, 15; alpha 255, 255, the first of which is -1.
  const std::vector<Rgba> cells = {0xff10ff01, 0xff0f0002};
  const Valid valid = {1, 1};
  const std::string data = EncodeCells(std::span<const Rgba>(cells), {valid, 2});
  EXPECT_EQ(data, Bytes({2, 2, 1, 2, 32, 1, 1, 0}));
  EXPECT_EQ(DecodeColors(data, {valid, 2}), cells);
}

class RandomCells : public testing::TestWithParam<int> {};

TEST_P(RandomCells, ComeBackAsTheyWere) {
  std::mt19937 random(static_cast<unsigned>(GetParam()));
  const std::size_t columns = 1 + random() % 40;
  const std::size_t rows = 1 + random() % 40;
  const auto percent_valid = random() % 101;
  const bool noisy = random() % 2 == 0;
  Valid valid(columns * rows);
  Cells cells(valid.size());
  std::vector<Rgba> colors(valid.size());
  for (std::size_t i = 0; i < valid.size(); ++i) {
    valid[i] = random() % 100 < percent_valid;
    if (!valid[i]) continue;
    cells[i] = static_cast<std::int16_t>(noisy ? random() : 3 * (i % columns) + random() % 5);
    colors[i] = static_cast<Rgba>(random());
  }
  const CellMask mask{valid, columns};
  const std::string data = Encode(cells, valid, columns);
  EXPECT_EQ(data.size(), 2 * mask.num_valid());
  EXPECT_EQ(DecodeCells(data, mask), cells);
  const std::string color_data = EncodeCells(std::span<const Rgba>(colors), mask);
  EXPECT_EQ(color_data.size(), 4 * mask.num_valid());
  EXPECT_EQ(DecodeColors(color_data, mask), colors);
}

INSTANTIATE_TEST_SUITE_P(Seeds, RandomCells, testing::Range(0, 60));

TEST(DecodeCells, TakesAnyBytes) {
  std::mt19937 random(5);
  const Valid valid(64, 1);
  for (int i = 0; i < 200; ++i) {
    std::string data(128, '\0');
    for (char& byte : data) byte = static_cast<char>(random());
    EXPECT_EQ(Encode(DecodeCells(data, {valid, 8}), valid, 8), data) << "one to one";
  }
}

}  // namespace
}  // namespace gem::wire
