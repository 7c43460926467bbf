#include "proto/wire/scan_codec.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

namespace gem::wire {
namespace {

using testing::ElementsAre;

std::string Bytes(std::initializer_list<int> bytes) {
  std::string result;
  for (const int byte : bytes) result.push_back(static_cast<char>(byte));
  return result;
}

TEST(ColumnsOf, AreTheFieldsByOffset) {
  const std::vector<PointColumn> fields = {{4, 2}, {0, 4}};
  EXPECT_THAT(ColumnsOf(fields, 6), ElementsAre(PointColumn{0, 4}, PointColumn{4, 2}));
}

TEST(ColumnsOf, TakeWhatNoFieldCoversByteByByte) {
  const std::vector<PointColumn> fields = {{1, 2}};
  EXPECT_THAT(ColumnsOf(fields, 5), ElementsAre(PointColumn{0, 1}, PointColumn{1, 2},
                                                PointColumn{3, 1}, PointColumn{4, 1}));
}

TEST(ColumnsOf, LeaveOutFieldsThatShareBytesWithAnEarlierOne) {
  const std::vector<PointColumn> fields = {{0, 2}, {1, 4}, {0, 2}, {2, 2}};
  EXPECT_THAT(ColumnsOf(fields, 5),
              ElementsAre(PointColumn{0, 2}, PointColumn{2, 2}, PointColumn{4, 1}));
}

TEST(EncodeDeltas, PutsPlanesOfDifferencesOneBehindTheOther) {
  // Points (5, 300) and (4, 301): differences 5, -1 as 10, 1; 300 = 600 = 0x258, 1 = 2.
  const std::vector<PointColumn> columns = {{0, 1}, {1, 2}};
  EXPECT_EQ(EncodeDeltas(Bytes({5, 0x2c, 1, 4, 0x2d, 1}), 3, columns),
            Bytes({10, 1, 0x58, 2, 2, 0}));
}

TEST(EncodeDeltas, WrapsAround) {
  // From 32767 to -32768 it is one step up: 1, as 2. So are floats' bits: unsigned 32 bits.
  const std::vector<PointColumn> int16 = {{0, 2}};
  EXPECT_EQ(EncodeDeltas(Bytes({0xff, 0x7f, 0x00, 0x80}), 2, int16), Bytes({0xfe, 2, 0xff, 0}));
  const std::vector<PointColumn> float32 = {{0, 4}};
  EXPECT_EQ(EncodeDeltas(Bytes({0xff, 0xff, 0xff, 0xff, 0, 0, 0, 0}), 4, float32),
            Bytes({1, 2, 0, 0, 0, 0, 0, 0}));
}

TEST(EncodeDeltas, OfNoPointsIsNothing) {
  const std::vector<PointColumn> columns = {{0, 4}};
  EXPECT_EQ(EncodeDeltas("", 4, columns), "");
  EXPECT_EQ(DecodeDeltas("", 4, columns), "");
}

TEST(DecodeDeltas, GivesBackEveryByteOfEveryLayout) {
  std::mt19937 random(1);
  for (int i = 0; i < 200; ++i) {
    const auto stride = static_cast<std::uint32_t>(1 + random() % 40);
    std::vector<PointColumn> fields;
    for (int k = 0; k < 6; ++k) {
      const std::uint32_t width = 1u << random() % 3;
      if (width > stride) continue;
      fields.push_back({static_cast<std::uint32_t>(random() % (stride - width + 1)), width});
    }
    const std::vector<PointColumn> columns = ColumnsOf(fields, stride);
    std::string points(stride * (random() % 50), '\0');
    for (char& byte : points) byte = static_cast<char>(random());
    EXPECT_EQ(DecodeDeltas(EncodeDeltas(points, stride, columns), stride, columns), points);
    EXPECT_EQ(EncodeDeltas(DecodeDeltas(points, stride, columns), stride, columns), points)
        << "one to one";
  }
}

}  // namespace
}  // namespace gem::wire
