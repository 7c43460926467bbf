// Packed points make the same map as the points that they stand for, bit for bit.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <random>
#include <vector>

#include "core/base/vector_set.h"
#include "core/local/cpu_mapper.h"
#include "core/local/local_mapper.h"
#include "tests/core/local/scenes.h"

namespace gem {
namespace {

// Random values from corner to corner, the extremes among them.
struct Packed {
  Packed(std::size_t count, std::uint32_t stride, std::array<std::uint32_t, 3> offset)
      : bytes(count * stride, 'x') {
    std::mt19937 random(static_cast<unsigned>(count + stride));
    std::uniform_int_distribution<int> value(-3000, 3000);
    for (std::size_t i = 0; i < count; ++i) {
      for (std::size_t axis = 0; axis < 3; ++axis) {
        int v = axis == 2 ? value(random) / 8 - 400 : value(random);
        if (i % 97 == 0) v = random() % 2 == 0 ? -32768 : 32767;
        const auto narrow = static_cast<std::int16_t>(v);
        std::memcpy(bytes.data() + i * stride + offset[axis], &narrow, sizeof(narrow));
      }
    }
    packed = {bytes.data(), count, stride, offset, {0.004f, 0.004f, 0.005f}};
    for (std::size_t i = 0; i < count; ++i) points.push_back(PointAt(packed, i));
  }
  std::vector<char> bytes;  // a short string would move with us, and `packed` views it
  PackedPoints packed;
  std::vector<ScanPoint> points;
};

Scan ScanAt(int i) {
  Scan scan;
  scan.seq = static_cast<std::uint64_t>(i + 1);
  scan.stamp_ns = (i + 1) * std::int64_t{100'000'000};
  scan.T_O_B = Pose<Odom, Base>::FromTranslation(0.3 * i, -0.1 * i, 0);
  scan.T_B_S = Pose<Base, Sensor>::FromTranslation(0.1, 0, 1.7);
  scan.noise = testing::LidarNoiseModel();
  return scan;
}

// The map after some scans; whichever of the two forms of the points it got.
LocalMap MapOf(LocalMapper& mapper, const std::vector<Packed>& scans, bool is_packed) {
  std::vector<EvictedCell> evicted;
  for (std::size_t i = 0; i < scans.size(); ++i) {
    Scan scan = ScanAt(static_cast<int>(i));
    if (is_packed) {
      scan.packed = scans[i].packed;
    } else {
      scan.points = scans[i].points;
    }
    EXPECT_EQ(mapper.FuseScan(scan, evicted).points, scans[i].points.size());
  }
  LocalMap map;
  mapper.CopyTo(map);
  return map;
}

void ExpectSameMap(const LocalMap& a, const LocalMap& b) {
  EXPECT_EQ(a.state, b.state);
  EXPECT_EQ(a.elevation_m, b.elevation_m);
  EXPECT_EQ(a.variance_m2, b.variance_m2);
  EXPECT_EQ(a.traversability, b.traversability);
  EXPECT_EQ(a.observed_ns, b.observed_ns);
}

std::vector<Packed> Scans() {
  std::vector<Packed> scans;
  // Of a block and beside it; tight, with something between the values, and in another order.
  for (const std::size_t count : {std::size_t{20'000}, std::size_t{1}, std::size_t{256},
                                  std::size_t{257}, std::size_t{5'011}}) {
    scans.emplace_back(count, 6, std::array<std::uint32_t, 3>{0, 2, 4});
    scans.emplace_back(count, 11, std::array<std::uint32_t, 3>{1, 9, 4});
  }
  return scans;
}

TEST(PackedPointsMapper, EveryVectorSetAndNumberOfThreadsMeasuresThemAsPoints) {
  const std::vector<Packed> scans = Scans();
  const LocalMapOptions options;
  for (const VectorSet set : {VectorSet::kBaseline, VectorSet::kAvx2, VectorSet::kAvx512}) {
    if (!IsSupported(set)) continue;
    for (const int threads : {1, 3}) {
      const LocalMap expected = MapOf(*MakeCpuMapper(options, threads, set), scans, false);
      const LocalMap actual = MapOf(*MakeCpuMapper(options, threads, set), scans, true);
      ExpectSameMap(expected, actual);
      EXPECT_GT(std::count_if(actual.state.begin(), actual.state.end(),
                              [](auto state) { return state != 0; }),
                1000);
    }
  }
}

TEST(PackedPointsMapper, TheReferenceMeasuresThemAsPoints) {
  const std::vector<Packed> scans = Scans();
  const LocalMapOptions options;
  ExpectSameMap(MapOf(**MakeLocalMapper(LocalBackend::kReference, options), scans, false),
                MapOf(**MakeLocalMapper(LocalBackend::kReference, options), scans, true));
}

}  // namespace
}  // namespace gem
