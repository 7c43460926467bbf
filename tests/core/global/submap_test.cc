#include "core/global/submap.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <random>
#include <set>

#include "scenes.h"

namespace gem {
namespace {

using test::Cell;
using test::Flat;
using test::kSecond_ns;
using test::MakeSubmap;

TEST(Submap, KnowsWhatItWasGivenAndNothingElse) {
  // Across the seams of groups and of signs.
  std::mt19937 random(1);
  std::uniform_int_distribution<std::int32_t> coordinate(-40, 40);
  std::set<CellIndex> wanted;
  while (wanted.size() < 500) wanted.insert({coordinate(random), coordinate(random)});
  std::vector<KeyedSubmapCell> cells;
  for (const CellIndex c : wanted)
    cells.push_back({c, Cell(static_cast<float>(c.x * 100 + c.y), kSecond_ns)});
  std::shuffle(cells.begin(), cells.end(), random);

  const Submap submap({}, cells);
  EXPECT_EQ(submap.num_cells(), 500u);
  for (CellIndex c{-60, -60}; c.y < 60; ++c.y) {
    for (c.x = -60; c.x < 60; ++c.x) {
      const auto position = submap.Find(c);
      ASSERT_EQ(position.has_value(), wanted.contains(c)) << c.x << " " << c.y;
      if (position) {
        EXPECT_EQ(submap.elevation_m(*position), static_cast<float>(c.x * 100 + c.y));
      }
    }
  }
}

TEST(Submap, OrderOfCellsDoesNotMatter) {
  std::vector<KeyedSubmapCell> cells;
  for (int i = 0; i < 100; ++i)
    cells.push_back({{i * 7 % 50 - 25, i / 2}, Cell(static_cast<float>(i), i * kSecond_ns)});
  const Submap forwards({}, cells);
  std::reverse(cells.begin(), cells.end());
  const Submap backwards({}, cells);
  const auto a = forwards.Cells(), b = backwards.Cells();
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    EXPECT_EQ(a[i].cell, b[i].cell);
    EXPECT_EQ(a[i].value, b[i].value);
    EXPECT_EQ(forwards.Find(a[i].cell), i) << "Cells() must be in order of position";
  }
}

TEST(Submap, IsNeverFreerThanItWas) {
  // 0.7 is 178.5 of 255: rounding to nearest would say 0.702 and call it free.
  SubmapCell cell = Cell(0, 0);
  cell.traversability = 0.7f;
  const Submap submap({}, {{{0, 0}, cell}});
  EXPECT_FLOAT_EQ(submap.At(0).traversability, 178.0f / 255.0f);
}

TEST(Submap, CopyingACellManyTimesChangesNothing) {
  for (int step = 0; step <= 255; ++step) {
    SubmapCell cell = Cell(1.5f, 123'456'789);
    cell.traversability = static_cast<float>(step) / 255.0f;
    cell.rgba = 0xff102030u;
    cell.state |= kCellColored;
    const SubmapCell once = Submap({}, {{{3, 4}, cell}}).At(0);
    const SubmapCell twice = Submap({}, {{{3, 4}, once}}).At(0);
    EXPECT_EQ(once, twice);
    EXPECT_EQ(once.traversability, cell.traversability);
    EXPECT_EQ(once.rgba, 0xff102030u);
    EXPECT_EQ(once.stamp_ns, 123'000'000) << "whole milliseconds";
  }
}

TEST(Submap, StampsAYearApartKeepTheirOrder) {
  // Merging puts an observation of today beside one of last year; 32 bits of milliseconds hold 49
  // days.
  const std::int64_t year_ns = 365 * 24 * 3600 * kSecond_ns;
  const Submap submap({}, {{{0, 0}, Cell(0, 5 * kSecond_ns)}, {{1, 0}, Cell(0, year_ns)}});
  EXPECT_EQ(submap.first_stamp_ns(), 5 * kSecond_ns);
  EXPECT_EQ(submap.last_stamp_ns(), year_ns);
  EXPECT_EQ(submap.At(1).stamp_ns, year_ns);
  EXPECT_LT(submap.At(0).stamp_ns, year_ns - 49 * 24 * 3600 * kSecond_ns);
}

TEST(Submap, NeedsAtMost40BytesAPoint) {
  // 20 m of path with an 8 m window at 0.2 m, straight and diagonal.
  const auto straight = MakeSubmap("a", 1, {}, {{-20, -20}, {120, 20}}, Flat(0));
  EXPECT_LE(static_cast<double>(straight->size_bytes()),
            40.0 * static_cast<double>(straight->num_cells()));

  std::vector<KeyedSubmapCell> cells;
  for (std::int32_t y = -20; y < 90; ++y)
    for (std::int32_t x = -20; x < 90; ++x)
      if (std::abs(x - y) < 28) cells.push_back({{x, y}, Cell(0, 1)});
  const Submap diagonal({}, cells);
  EXPECT_LE(static_cast<double>(diagonal.size_bytes()),
            40.0 * static_cast<double>(diagonal.num_cells()));
}

TEST(Submap, WithoutCellsIsEmpty) {
  const Submap submap({}, {});
  EXPECT_TRUE(submap.empty());
  EXPECT_TRUE(submap.rect().empty());
  EXPECT_FALSE(submap.Find({0, 0}).has_value());
  EXPECT_TRUE(submap.Cells().empty());
}

TEST(SubmapDeathTest, ACellTwiceIsAnError) {
  EXPECT_DEATH(Submap({}, {{{1, 1}, Cell(0, 0)}, {{1, 1}, Cell(1, 0)}}), "check failed");
}

TEST(SubmapDeathTest, CellsTooFarApartAreAnError) {
  EXPECT_DEATH(Submap({}, {{{0, 0}, Cell(0, 0)}, {{kSubmapSideCells_max, 0}, Cell(1, 0)}}),
               "check failed");
}

TEST(Submap, KnowsItsPartsWhateverTheOrderOfItsCells) {
  // 40 m along x: 200 cells are 13 groups, in parts of two.
  const auto submap = MakeSubmap("a", 7'000'000, {}, {{0, 0}, {200, 16}}, Flat(1.5f));
  ASSERT_EQ(submap->parts().size(), 7u);
  const SubmapPart& first = submap->parts().front();
  EXPECT_NEAR(first.middle.x(), 3.2, 1e-6) << "the middle of 32 cells of 0.2 m";
  EXPECT_NEAR(first.middle.y(), 1.6, 1e-6);
  EXPECT_NEAR(first.middle.z(), 1.5, 1e-6);
  EXPECT_EQ(first.num_cells, 32 * 16);
  EXPECT_EQ(first.stamp_ns, 7'000'000);

  std::vector<KeyedSubmapCell> cells = submap->Cells();
  std::reverse(cells.begin(), cells.end());
  const Submap reversed(submap->origin(), cells);
  for (std::size_t i = 0; i < reversed.parts().size(); ++i)
    EXPECT_EQ(reversed.parts()[i].middle.xyz(), submap->parts()[i].middle.xyz());
}

}  // namespace
}  // namespace gem
