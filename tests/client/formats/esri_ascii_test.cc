#include "client/formats/esri_ascii.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "client/formats/text_file.h"
#include "tests/client/temporary_directory.h"

namespace gem {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

std::string ErrorOf(const std::string& contents) {
  const TemporaryDirectory dir;
  const auto grid = ReadEsriAscii(dir.Write("dem.asc", contents));
  return grid.ok() ? "no error" : std::string(grid.status().message());
}

TEST(EsriAscii, HasTheNorthRowFirst) {
  const TemporaryDirectory dir;
  const auto grid = ReadEsriAscii(dir.Write(
      "dem.asc",
      "NCOLS 3\nnrows 2\nXllCorner -10.5\nyllcorner 20\ncellsize 0.5\nNODATA_value -9999\n"
      "1 2 -9999\n4 5 6\n"));
  ASSERT_TRUE(grid.ok()) << grid.status();
  EXPECT_EQ(grid->columns, 3);
  EXPECT_EQ(grid->rows, 2);
  EXPECT_EQ(grid->x_m_min, -10.5);
  EXPECT_EQ(grid->y_m_min, 20);
  EXPECT_EQ(grid->cell_size_m, 0.5);
  EXPECT_THAT(grid->values, ElementsAre(4, 5, 6, 1, 2, 0));
  EXPECT_THAT(grid->valid, ElementsAre(1, 1, 1, 1, 1, 0));
}

TEST(EsriAscii, TakesCentersAndNoNoDataValue) {
  const TemporaryDirectory dir;
  const auto grid = ReadEsriAscii(
      dir.Write("dem.asc", "ncols 1 nrows 1 xllcenter 5 yllcenter 6 cellsize 2 -9999"));
  ASSERT_TRUE(grid.ok()) << grid.status();
  EXPECT_EQ(grid->x_m_min, 4);
  EXPECT_EQ(grid->y_m_min, 5);
  // Without the key, -9999 is a height like any other.
  EXPECT_THAT(grid->values, ElementsAre(-9999));
  EXPECT_THAT(grid->valid, ElementsAre(1));
}

TEST(EsriAscii, ReadsBackWhatItWroteToTheLastBit) {
  EsriAsciiGrid grid;
  grid.columns = 2;
  grid.rows = 3;
  grid.x_m_min = -0.1 * 128;
  grid.y_m_min = 1e5 + 1.0 / 3;
  grid.cell_size_m = 0.20000000298023224;
  grid.values = {0.1f, -1.0f / 3, 123456.789f, 0, 1e-20f, -0.0f};
  grid.valid = {1, 1, 1, 0, 1, 1};
  const TemporaryDirectory dir;
  const auto read = ReadEsriAscii(dir.Write("dem.asc", ToEsriAscii(grid)));
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_EQ(read->columns, 2);
  EXPECT_EQ(read->rows, 3);
  EXPECT_EQ(read->x_m_min, grid.x_m_min);
  EXPECT_EQ(read->y_m_min, grid.y_m_min);
  EXPECT_EQ(read->cell_size_m, grid.cell_size_m);
  EXPECT_EQ(read->values, grid.values);
  EXPECT_EQ(read->valid, grid.valid);
}

TEST(EsriAscii, NamesTheLineOfABadHeader) {
  EXPECT_THAT(ErrorOf("ncols 1\nfoo 2\n"), HasSubstr("dem.asc:2: unknown header key \"foo\""));
  EXPECT_THAT(ErrorOf("ncols 1\nnrows many\n"), HasSubstr("dem.asc:2: nrows is \"many\""));
  EXPECT_THAT(ErrorOf("ncols 1\nnrows 1\nxllcorner 0\ncellsize 1\n5\n"),
              HasSubstr("dem.asc: the header lacks yllcorner"));
  EXPECT_THAT(ErrorOf("ncols 1.5 nrows 1 xllcorner 0 yllcorner 0 cellsize 1 5"),
              HasSubstr("ncols is 1.5"));
  EXPECT_THAT(ErrorOf("ncols 1 nrows 1 xllcorner 0 yllcorner 0 cellsize 0 5"),
              HasSubstr("cellsize is 0, want (0, 1000000)"));
  EXPECT_THAT(ErrorOf(""), HasSubstr("lacks ncols"));
}

TEST(EsriAscii, NamesTheLineOfABadHeight) {
  const std::string header = "ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 1\n";
  EXPECT_THAT(ErrorOf(header + "1 2\n3 x\n"), HasSubstr("dem.asc:7: \"x\" is not a number"));
  EXPECT_THAT(ErrorOf(header + "1 2\n3 inf\n"), HasSubstr("dem.asc:7: inf is too large"));
  EXPECT_THAT(ErrorOf(header + "1 2\n3\n"), HasSubstr("the file ends in row 2, column 2"));
  EXPECT_THAT(ErrorOf(header + "1 2\n3 4\n5\n"), HasSubstr("dem.asc:8: more than 2 x 2 values"));
}

TEST(EsriAscii, DoesNotAllocateWhatAHeaderClaims) {
  EXPECT_THAT(ErrorOf("ncols 16000 nrows 16000 xllcorner 0 yllcorner 0 cellsize 1 5"),
              HasSubstr("ends before 16000 x 16000 values"));
  EXPECT_THAT(ErrorOf("ncols 1e6 nrows 1e6 xllcorner 0 yllcorner 0 cellsize 1 5"),
              HasSubstr("want at most 268435456"));
}

TEST(TextFile, IsReplacedAsAWhole) {
  const TemporaryDirectory dir;
  dir.Write("out.txt", "old and longer");
  ASSERT_TRUE(WriteFileAtomically(dir.File("out.txt"), "new").ok());
  EXPECT_EQ(ReadFile(dir.File("out.txt"), 100).value(), "new");
  // Nothing else is left behind.
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(dir.path()), {}), 1);
}

TEST(TextFile, NamesThePathThatCannotBeWritten) {
  EXPECT_THAT(std::string(WriteFileAtomically("/nowhere/out.txt", "x").message()),
              HasSubstr("/nowhere/out.txt: cannot be written: No such file or directory"));
}

TEST(TextFile, RefusesAFileOverTheLimit) {
  const TemporaryDirectory dir;
  EXPECT_THAT(std::string(ReadFile(dir.Write("big", "12345"), 4).status().message()),
              HasSubstr("5 bytes, want at most 4"));
}

}  // namespace
}  // namespace gem
