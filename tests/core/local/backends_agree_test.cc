// Every backend answers to the reference, on the same scans.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <random>

#include "core/local/cpu_mapper.h"
#include "core/local/local_mapper.h"
#include "tests/core/local/compare_maps.h"
#include "tests/core/local/scenes.h"

namespace gem {
namespace {

using testing::DifferenceOf;
using testing::EveryPointCountedOnce;
using testing::PointScan;

// The reference and the cpu backend, fed alike.
class Pair {
 public:
  explicit Pair(const LocalMapOptions& options)
      : expected_(*MakeLocalMapper(LocalBackend::kReference, options)),
        actual_(*MakeLocalMapper(LocalBackend::kCpu, options)) {}

  /// Fuses the scan into both; the first difference in words, or "".
  std::string Fuse(const Scan& scan) {
    expected_evicted_.clear();
    actual_evicted_.clear();
    report_ = expected_->FuseScan(scan, expected_evicted_);
    const ScanReport actual_report = actual_->FuseScan(scan, actual_evicted_);
    expected_->CopyTo(expected_map_);
    actual_->CopyTo(actual_map_);
    cleared_ += report_.cells_cleared;
    restarted_ += report_.cells_restarted;
    inflated_ += report_.cells_inflated;
    if (!EveryPointCountedOnce(actual_report)) return "a point is not counted once";
    std::string difference = DifferenceOf(report_, actual_report);
    if (difference.empty()) difference = DifferenceOfEvicted();
    if (difference.empty()) difference = DifferenceOf(expected_map_, actual_map_);
    return difference;
  }

  const ScanReport& report() const { return report_; }
  LocalMap& expected_map() { return expected_map_; }
  LocalMap& actual_map() { return actual_map_; }
  std::uint64_t cleared() const { return cleared_; }
  std::uint64_t restarted() const { return restarted_; }
  std::uint64_t inflated() const { return inflated_; }

 private:
  std::string DifferenceOfEvicted() const {
    if (expected_evicted_.size() != actual_evicted_.size()) return "evicted counts differ";
    for (std::size_t i = 0; i < expected_evicted_.size(); ++i) {
      CellBelief a = expected_evicted_[i].belief, b = actual_evicted_[i].belief;
      const float difference = std::fabs(a.traversability - b.traversability);
      a.traversability = b.traversability = 0;
      if (expected_evicted_[i].cell != actual_evicted_[i].cell || a != b ||
          difference > testing::kAnnotationTolerance) {
        return absl::StrCat("evicted cell ", i, " differs");
      }
    }
    return "";
  }

  std::unique_ptr<LocalMapper> expected_, actual_;
  std::vector<EvictedCell> expected_evicted_, actual_evicted_;
  LocalMap expected_map_, actual_map_;
  ScanReport report_;
  std::uint64_t cleared_ = 0, restarted_ = 0, inflated_ = 0;
};

// A tilted robot on its way, with a tilted sensor beside it, an unsure attitude and colours.
Scan RandomPoseScan(std::mt19937& random, int i) {
  std::uniform_real_distribution<double> tilt_rad(-0.2, 0.2);
  Scan scan;
  scan.seq = static_cast<std::uint64_t>(i + 1);
  scan.stamp_ns = 1'700'000'000'000'000'000 + i * std::int64_t{100'000'000};
  const Eigen::Quaterniond rotation =
      Eigen::AngleAxisd(0.1 * i, Eigen::Vector3d::UnitZ()) *
      Eigen::AngleAxisd(tilt_rad(random), Eigen::Vector3d::UnitX()) *
      Eigen::AngleAxisd(tilt_rad(random), Eigen::Vector3d::UnitY());
  scan.T_O_B = {rotation, {-3 + 0.31 * i, 2 - 0.17 * i, 100 + 0.02 * i}};
  scan.T_B_S = {Eigen::Quaterniond(Eigen::AngleAxisd(0.3, Eigen::Vector3d(1, 2, 3).normalized())),
                {0.4, -0.3, 1.5}};
  scan.rotation_covariance_rad2.diagonal() << 1e-5, 2e-5, 3e-5;
  scan.noise = testing::LidarNoiseModel();
  return scan;
}

TEST(BackendsAgree, OnSimulatedScansOfATiltedRobotThatMoves) {
  std::uint64_t cleared = 0, restarted = 0, inflated = 0;
  for (unsigned seed = 1; seed <= 4; ++seed) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> place_m(-6, 6);
    LocalMapOptions options;
    options.cell_size_m = seed % 2 == 0 ? 0.2f : 0.13f;
    Pair pair(options);
    testing::Lidar lidar;
    lidar.columns = 500;
    lidar.sigma_m = 0.02;
    testing::World world;
    world.ground_m = 98.5;
    for (int i = 0; i < 12; ++i) {
      const double x_m = place_m(random);  // one by one: compilers order arguments differently
      const double y_m = place_m(random);
      world.boxes.push_back(testing::BoxOn(x_m, y_m, 0.5, 0.4 + 0.1 * i, world.ground_m));
    }
    for (int i = 0; i < 25; ++i) {
      Scan scan = RandomPoseScan(random, i);
      testing::World now = world;
      now.boxes.push_back(testing::BoxOn(-4 + 0.3 * i, 1.0, 0.5, 1.7, world.ground_m));
      if (i >= 15) now.ground_m -= 0.2;
      std::vector<ScanPoint> points = lidar.Sweep(now, scan.T_O_B * scan.T_B_S, random);
      for (ScanPoint& point : points) {
        if (random() % 3 != 0) point.rgba = 0xff000000u | (static_cast<Rgba>(random()) & 0xffffffu);
      }
      scan.points = points;
      ASSERT_EQ(pair.Fuse(scan), "") << "seed " << seed << ", scan " << i;
    }
    cleared += pair.cleared();
    restarted += pair.restarted();
    inflated += pair.inflated();
  }
  // The scenes asked for every outcome.
  EXPECT_GT(cleared, 20u);
  EXPECT_GT(restarted, 20u);
  EXPECT_GT(inflated, 0u);
}

TEST(BackendsAgree, OnPointsThrownAtRandom) {
  for (unsigned seed = 1; seed <= 6; ++seed) {
    std::mt19937 random(seed);
    std::normal_distribution<float> place_m(0, 4), height_m(-1, 0.7f);
    LocalMapOptions options;
    options.body = {-0.5f, -0.5f, -1, 0.5f, 0.5f, 1};
    options.variance_growth_m2_per_s = 1e-3f;
    Pair pair(options);
    for (int i = 0; i < 30; ++i) {
      Scan scan = RandomPoseScan(random, i);
      std::vector<ScanPoint> points(3000);
      for (ScanPoint& p : points) {
        p = {place_m(random), place_m(random), height_m(random), static_cast<Rgba>(random())};
      }
      scan.points = points;
      ASSERT_EQ(pair.Fuse(scan), "") << "seed " << seed << ", scan " << i;
    }
    EXPECT_GT(pair.cleared(), 0u);
  }
}

TEST(BackendsAgree, OnNastyScans) {
  LocalMapOptions options;
  options.range_m_min = 0;
  Pair pair(options);
  std::uint64_t seq = 1;
  const auto expect_same = [&](PointScan& scan, const char* what) {
    EXPECT_EQ(pair.Fuse(scan.At(seq++)), "") << what;
  };
  PointScan empty;
  expect_same(empty, "an empty first scan");
  PointScan one;
  one.Add(1, 1, 0.5);
  expect_same(one, "one point");
  PointScan origin(Pose<Odom, Base>(), {});
  origin.Add(0, 0, 0);
  expect_same(origin, "the sensor's own origin");
  PointScan one_cell;
  for (int i = 0; i < 5000; ++i) one_cell.Add(1.05, 1.05, 0.001 * (i % 997));
  expect_same(one_cell, "all points in one cell");
  PointScan borders;
  for (int y = -21; y <= 21; ++y) {
    for (int x = -21; x <= 21; ++x) borders.Add(0.2 * x, 0.2 * y, 0.1 * ((x + y) & 3));
  }
  expect_same(borders, "points on the borders of cells");
  PointScan negative(Pose<Odom, Base>::FromTranslation(-1000.1, -2000.3, -50), {});
  negative.AddCells({{-5021, -10022}, {-4981, -9982}}, 0.2,
                    [](double x, double) { return 0.1 * x + 50; });
  expect_same(negative, "negative coordinates");
  PointScan seam(Pose<Odom, Base>::FromTranslation(-1003.9, -1996.4, -50), {});
  seam.Add(-1004.5, -1996.1, -50);
  expect_same(seam, "a move across the seam");
  PointScan huge(Pose<Odom, Base>::FromTranslation(999'999.9, -999'999.9, 900'000), {});
  huge.scan().points = {};
  huge.Add(999'998, -999'998, 900'000).AddAll({{3e38f, -3e38f, 3e38f, 0}, {1e-38f, 0, 0, 0}});
  expect_same(huge, "the far end of O");
  // The sensor stands off the window, which rays cross from outside.
  PointScan aside(Pose<Odom, Base>(), Pose<Base, Sensor>::FromTranslation(6, 5, 2));
  for (int i = 0; i < 2000; ++i) aside.Add(4 - 0.004 * i, 4 - 0.0041 * (i % 1900), 0.3 * (i % 7));
  expect_same(aside, "a sensor beside the window");
  PointScan aside_again(Pose<Odom, Base>(), Pose<Base, Sensor>::FromTranslation(6, 5, 2));
  for (int i = 0; i < 2000; ++i) aside_again.Add(-5, 5 - 0.005 * i, 0);
  expect_same(aside_again, "rays across the window");
  EXPECT_GT(pair.cleared(), 0u);
}

TEST(BackendsAgree, AWrongCellIsSeen) {
  Pair pair(LocalMapOptions{});
  PointScan scan;
  scan.AddCells({{-20, -20}, {20, 20}}, 0.2, [](double x, double) { return 0.1 * x; });
  ASSERT_EQ(pair.Fuse(scan.At(1)), "");
  const LocalMap good = pair.actual_map();
  LocalMap& map = pair.actual_map();
  constexpr std::size_t kCell = 777;
  const auto expect_seen = [&](auto spoil) {
    map = good;
    spoil();
    EXPECT_NE(DifferenceOf(pair.expected_map(), map), "");
  };
  expect_seen([&] { map.elevation_m[kCell] = std::nextafter(map.elevation_m[kCell], 9.0f); });
  expect_seen([&] { map.variance_m2[kCell] *= 1.0001f; });
  expect_seen([&] { map.slope_rad[kCell] += 1e-4f; });
  expect_seen([&] { map.roughness_m[kCell] += 1e-4f; });
  expect_seen([&] { map.traversability[kCell] = std::nanf(""); });
  expect_seen([&] { map.state[kCell] = kCellKnown; });
  expect_seen([&] { map.rgba[kCell] ^= 1; });
  expect_seen([&] { ++map.observed_ns[kCell]; });
  expect_seen([&] { std::swap(map.elevation_m[0], map.elevation_m[1]); });
}

TEST(Determinism, TheSameScansTwiceGiveTheSameBytes) {
  for (const LocalBackend backend : {LocalBackend::kReference, LocalBackend::kCpu}) {
    LocalMap maps[2];
    std::vector<EvictedCell> evicted[2];
    for (int run = 0; run < 2; ++run) {
      auto mapper = *MakeLocalMapper(backend, LocalMapOptions());
      std::mt19937 random(9);
      std::normal_distribution<float> place_m(0, 3);
      for (int i = 0; i < 15; ++i) {
        Scan scan = RandomPoseScan(random, i);
        std::vector<ScanPoint> points(4000);
        for (ScanPoint& p : points) p = {place_m(random), place_m(random), -1, 0xff000000u | 77u};
        scan.points = points;
        mapper->FuseScan(scan, evicted[run]);
      }
      mapper->CopyTo(maps[run]);
    }
    EXPECT_EQ(maps[0].elevation_m, maps[1].elevation_m);
    EXPECT_EQ(maps[0].variance_m2, maps[1].variance_m2);
    EXPECT_EQ(maps[0].traversability, maps[1].traversability);
    EXPECT_EQ(maps[0].slope_rad, maps[1].slope_rad);
    EXPECT_EQ(maps[0].roughness_m, maps[1].roughness_m);
    EXPECT_EQ(maps[0].state, maps[1].state);
    EXPECT_EQ(maps[0].rgba, maps[1].rgba);
    ASSERT_EQ(evicted[0].size(), evicted[1].size());
    for (std::size_t i = 0; i < evicted[0].size(); ++i) {
      EXPECT_EQ(evicted[0][i].belief, evicted[1][i].belief);
    }
  }
}

// Fuses what BackendsAgree fuses on a robot that moves, and says what is in the map.
struct Drive {
  explicit Drive(LocalMapper& mapper) {
    std::mt19937 random(5);
    testing::Lidar lidar;
    lidar.columns = 600;
    lidar.sigma_m = 0.02;
    testing::World world;
    world.ground_m = 98.5;
    world.boxes = {testing::BoxOn(1, 2, 0.5, 1, 98.5), testing::BoxOn(-2, 1, 1, 2, 98.5)};
    for (int i = 0; i < 20; ++i) {
      Scan scan = RandomPoseScan(random, i);
      testing::World now = world;
      if (i % 2 == 0) now.boxes.push_back(testing::BoxOn(0.2 * i - 3, 0, 0.8, 1.7, world.ground_m));
      std::vector<ScanPoint> points = lidar.Sweep(now, scan.T_O_B * scan.T_B_S, random);
      // Uncoloured and coloured scans take different ways; some cells get very many points.
      for (ScanPoint& p : points) p.rgba = i % 4 == 3 ? 0xff000000u | i : 0;
      points.insert(points.end(), 700, points[i * 50]);
      scan.points = points;
      const ScanReport report = mapper.FuseScan(scan, evicted);
      cleared += report.cells_cleared;
      fused += report.points_fused;
    }
    mapper.CopyTo(map);
  }
  LocalMap map;
  std::vector<EvictedCell> evicted;
  std::uint64_t cleared = 0, fused = 0;
};

void ExpectSameBytes(const Drive& a, const Drive& b) {
  EXPECT_EQ(a.map.state, b.map.state);
  EXPECT_EQ(a.map.elevation_m, b.map.elevation_m);
  EXPECT_EQ(a.map.variance_m2, b.map.variance_m2);
  EXPECT_EQ(a.map.slope_rad, b.map.slope_rad);
  EXPECT_EQ(a.map.roughness_m, b.map.roughness_m);
  EXPECT_EQ(a.map.traversability, b.map.traversability);
  EXPECT_EQ(a.map.rgba, b.map.rgba);
  EXPECT_EQ(a.map.observed_ns, b.map.observed_ns);
  EXPECT_EQ(a.cleared, b.cleared);
  EXPECT_EQ(a.fused, b.fused);
  ASSERT_EQ(a.evicted.size(), b.evicted.size());
  for (std::size_t i = 0; i < a.evicted.size(); ++i) {
    EXPECT_EQ(a.evicted[i].belief, b.evicted[i].belief);
  }
}

TEST(Determinism, AnyNumberOfThreadsGivesTheSameBytes) {
  const Drive one(**MakeLocalMapper(LocalBackend::kCpu, LocalMapOptions(), 1));
  EXPECT_GT(one.cleared, 0u);
  EXPECT_GT(one.evicted.size(), 0u);
  for (const int threads : {2, 3, 7}) {
    ExpectSameBytes(one, Drive(**MakeLocalMapper(LocalBackend::kCpu, LocalMapOptions(), threads)));
  }
}

TEST(Determinism, EveryVectorSetGivesTheSameBytes) {
  const Drive baseline(*MakeCpuMapper(LocalMapOptions(), 1, VectorSet::kBaseline));
  for (const VectorSet set : {VectorSet::kAvx2, VectorSet::kAvx512}) {
    if (IsSupported(set))
      ExpectSameBytes(baseline, Drive(*MakeCpuMapper(LocalMapOptions(), 1, set)));
  }
}

TEST(Determinism, ThreadsHaveALimit) {
  EXPECT_FALSE(MakeLocalMapper(LocalBackend::kCpu, LocalMapOptions(), 0).ok());
  const auto mapper = MakeLocalMapper(LocalBackend::kCpu, LocalMapOptions(), 65);
  EXPECT_EQ(mapper.status().message(), "threads is 65, want [1, 64]");
}

// ---- real scans

std::vector<ScanPoint> ReadVelodyne(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  std::vector<ScanPoint> points;
  float xyzi[4];
  while (file.read(reinterpret_cast<char*>(xyzi), sizeof(xyzi))) {
    points.push_back({xyzi[0], xyzi[1], xyzi[2], 0});
  }
  return points;
}

TEST(BackendsAgree, OnRealScans) {
  const char* data = std::getenv("GEM_DATA_DIR");
  if (data == nullptr) GTEST_SKIP() << "set GEM_DATA_DIR to the unpacked KITTI data";
  const std::filesystem::path dir = std::filesystem::path(data) / "kitti_raw_0001";
  std::vector<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::directory_iterator(dir / "velodyne")) {
    files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  ASSERT_GE(files.size(), 8u) << dir;
  LocalMapOptions options;
  options.side_m = 16;
  Pair pair(options);
  std::ifstream poses(dir / "poses.txt");  // rows of T_G_velodyne
  for (int i = 0; i < 8; ++i) {
    Eigen::Matrix<double, 3, 4, Eigen::RowMajor> row;
    for (int k = 0; k < 12; ++k) poses >> row.data()[k];
    ASSERT_TRUE(poses) << dir / "poses.txt";
    Scan scan;
    scan.seq = static_cast<std::uint64_t>(i + 1);
    scan.stamp_ns = i * std::int64_t{100'000'000};
    const Eigen::Matrix3d rotation = row.leftCols<3>();
    scan.T_O_B = {Eigen::Quaterniond(rotation).normalized(), row.col(3)};
    scan.noise = testing::LidarNoiseModel();
    const std::vector<ScanPoint> points = ReadVelodyne(files[static_cast<std::size_t>(i)]);
    scan.points = points;
    ASSERT_GT(points.size(), 100'000u);
    ASSERT_EQ(pair.Fuse(scan), "") << files[static_cast<std::size_t>(i)];
  }
  EXPECT_GT(pair.cleared(), 0u);
}

}  // namespace
}  // namespace gem
