// The cuda backend, executed: bit for bit what the cpu backend gives, in whatever order the
// device's threads run.
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <memory>
#include <random>

#include "core/local/cpu_mapper.h"
#include "core/local/cuda/cuda_mapper.h"
#include "tests/core/local/compare_maps.h"
#include "tests/core/local/scenes.h"
#include "tests/emulation/emulation.h"

namespace gem {
namespace {

using gpu::emulation::SetSeed;
using testing::DifferenceOf;
using testing::PointScan;

/// The first difference in words, or ""; to the last bit, unlike compare_maps.h.
std::string BitDifferenceOf(const LocalMap& cpu, const LocalMap& cuda) {
  const std::string difference = DifferenceOf(cpu, cuda);
  if (!difference.empty()) return difference;
  if (cpu.slope_rad != cuda.slope_rad) return "slopes differ in their last bits";
  if (cpu.roughness_m != cuda.roughness_m) return "roughness differs in its last bits";
  if (cpu.traversability != cuda.traversability) return "traversability differs in its last bits";
  return "";
}

std::string DifferenceOfEvicted(const std::vector<EvictedCell>& cpu,
                                const std::vector<EvictedCell>& cuda) {
  if (cpu.size() != cuda.size()) return "evicted counts differ";
  for (std::size_t i = 0; i < cpu.size(); ++i) {
    if (cpu[i].cell != cuda[i].cell || cpu[i].belief != cuda[i].belief)
      return absl::StrCat("evicted cell ", i, " differs");
  }
  return "";
}

// The cpu and the emulated cuda backend, fed alike.
class Pair {
 public:
  explicit Pair(const LocalMapOptions& options)
      : cpu_(MakeCpuMapper(options, 1)), cuda_(*MakeCudaMapper(options)) {}

  /// Fuses the scan into both; the first difference in words, or "".
  std::string Fuse(const Scan& scan) {
    cpu_evicted_.clear();
    cuda_evicted_.clear();
    report_ = cpu_->FuseScan(scan, cpu_evicted_);
    const ScanReport cuda_report = cuda_->FuseScan(scan, cuda_evicted_);
    cleared_ += report_.cells_cleared;
    restarted_ += report_.cells_restarted;
    evicted_ += report_.cells_evicted;
    std::string difference = DifferenceOf(report_, cuda_report);
    if (difference.empty()) difference = DifferenceOfEvicted(cpu_evicted_, cuda_evicted_);
    if (difference.empty()) difference = DifferenceOfMaps();
    return difference;
  }
  std::string EvictAll() {
    cpu_evicted_.clear();
    cuda_evicted_.clear();
    cpu_->EvictAll(cpu_evicted_);
    cuda_->EvictAll(cuda_evicted_);
    std::string difference = DifferenceOfEvicted(cpu_evicted_, cuda_evicted_);
    return difference.empty() ? DifferenceOfMaps() : difference;
  }

  std::uint64_t cleared() const { return cleared_; }
  std::uint64_t restarted() const { return restarted_; }
  std::uint64_t evicted() const { return evicted_; }

 private:
  std::string DifferenceOfMaps() {
    cpu_->CopyTo(cpu_map_);
    cuda_->CopyTo(cuda_map_);
    return BitDifferenceOf(cpu_map_, cuda_map_);
  }

  std::unique_ptr<LocalMapper> cpu_, cuda_;
  std::vector<EvictedCell> cpu_evicted_, cuda_evicted_;
  LocalMap cpu_map_, cuda_map_;
  ScanReport report_;
  std::uint64_t cleared_ = 0, restarted_ = 0, evicted_ = 0;
};

// A tilted robot on its way, with a tilted sensor beside it and an unsure attitude.
Scan TiltedScan(std::mt19937& random, int i) {
  std::uniform_real_distribution<double> tilt_rad(-0.2, 0.2);
  Scan scan;
  scan.seq = static_cast<std::uint64_t>(i + 1);
  scan.stamp_ns = 1'700'000'000'000'000'000 + i * std::int64_t{100'000'000};
  const double roll_rad = tilt_rad(random);
  const double pitch_rad = tilt_rad(random);
  const Eigen::Quaterniond rotation = Eigen::AngleAxisd(0.1 * i, Eigen::Vector3d::UnitZ()) *
                                      Eigen::AngleAxisd(roll_rad, Eigen::Vector3d::UnitX()) *
                                      Eigen::AngleAxisd(pitch_rad, Eigen::Vector3d::UnitY());
  scan.T_O_B = {rotation, {-3 + 0.31 * i, 2 - 0.17 * i, 100 + 0.02 * i}};
  scan.T_B_S = {Eigen::Quaterniond(Eigen::AngleAxisd(0.3, Eigen::Vector3d(1, 2, 3).normalized())),
                {0.4, -0.3, 1.5}};
  scan.rotation_covariance_rad2.diagonal() << 1e-5, 2e-5, 3e-5;
  scan.noise = testing::LidarNoiseModel();
  return scan;
}

LocalMapOptions SmallWindow() {
  LocalMapOptions options;
  options.side_m = 4.6f;  // 23 cells: no multiple of a block
  return options;
}

TEST(EmulatedCuda, AgreesWithCpuOnPointsThrownAtRandom) {
  for (unsigned seed = 1; seed <= 3; ++seed) {
    SetSeed(seed);
    std::mt19937 random(seed);
    std::normal_distribution<float> place_m(0, 2), height_m(-1, 0.7f);
    LocalMapOptions options = SmallWindow();
    options.body = {-0.5f, -0.5f, -1, 0.5f, 0.5f, 1};
    options.variance_growth_m2_per_s = 1e-3f;
    Pair pair(options);
    for (int i = 0; i < 6; ++i) {
      Scan scan = TiltedScan(random, i);
      std::vector<ScanPoint> points(1500 - 100 * static_cast<std::size_t>(i % 3));
      for (ScanPoint& p : points) {
        p.x_m = place_m(random);
        p.y_m = place_m(random);
        p.z_m = height_m(random);
        p.rgba = random() % 3 == 0 ? 0 : 0xff000000u | (static_cast<Rgba>(random()) & 0xffffffu);
      }
      scan.points = points;
      ASSERT_EQ(pair.Fuse(scan), "") << "seed " << seed << ", scan " << i;
    }
    EXPECT_GT(pair.evicted(), 0u);
    EXPECT_EQ(pair.EvictAll(), "");
  }
}

TEST(EmulatedCuda, AgreesWithCpuWhateverOrderThreadsRunIn) {
  for (unsigned seed = 10; seed < 18; ++seed) {
    SetSeed(seed);
    std::mt19937 random(1);
    std::normal_distribution<float> place_m(0, 1), height_m(-1, 0.3f);
    std::vector<ScanPoint> points(500);
    for (ScanPoint& p : points) {
      p.x_m = place_m(random);
      p.y_m = place_m(random);
      p.z_m = height_m(random);
    }
    Pair pair(SmallWindow());
    for (int i = 0; i < 2; ++i) {
      Scan scan = TiltedScan(random, i);
      scan.points = points;
      ASSERT_EQ(pair.Fuse(scan), "") << "seed " << seed << ", scan " << i;
    }
  }
}

TEST(EmulatedCuda, AgreesWithCpuOnATiltedRobotThatMovesAmongBoxes) {
  SetSeed(4);
  std::mt19937 random(4);
  testing::Lidar lidar;
  lidar.rings = 24;
  lidar.columns = 120;
  lidar.elevation_rad_min = -1.3;
  lidar.sigma_m = 0.02;
  testing::World world;
  world.ground_m = 98.5;
  for (int i = 0; i < 6; ++i)
    world.boxes.push_back(testing::BoxOn(-3 + i, 1.5 - 0.5 * i, 0.4, 0.3 + 0.1 * i, 98.5));
  Pair pair(SmallWindow());
  for (int i = 0; i < 10; ++i) {
    Scan scan = TiltedScan(random, i);
    if (i >= 6) world.ground_m -= 0.2;  // ground that sinks
    const std::vector<ScanPoint> points = lidar.Sweep(world, scan.T_O_B * scan.T_B_S, random);
    scan.points = points;
    ASSERT_EQ(pair.Fuse(scan), "") << "scan " << i;
  }
  EXPECT_GT(pair.evicted(), 0u);
}

TEST(EmulatedCuda, AgreesWithCpuOnAWalkerThatIsCleared) {
  SetSeed(5);
  std::mt19937 random(5);
  testing::Lidar lidar;
  lidar.rings = 32;
  lidar.columns = 240;
  Pair pair(SmallWindow());
  for (int i = 0; i < 6; ++i) {
    testing::World world;
    world.boxes.push_back(testing::BoxOn(-1.5 + 0.6 * i, 1.0, 0.5, 1.2));
    world.boxes.push_back(testing::BoxOn(-1.0, -1.2, 0.4, 0.6));
    PointScan scan(1.5);
    scan.scan().noise = testing::LidarNoiseModel();
    scan.AddAll(lidar.Sweep(world, scan.scan().T_O_B * scan.scan().T_B_S, random));
    ASSERT_EQ(pair.Fuse(scan.At(static_cast<std::uint64_t>(i + 1))), "") << "scan " << i;
  }
  EXPECT_GT(pair.cleared(), 5u);
}

TEST(EmulatedCuda, AgreesWithCpuOnNastyScans) {
  SetSeed(6);
  LocalMapOptions options = SmallWindow();
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
  for (int i = 0; i < 1500; ++i) one_cell.Add(1.05, 1.05, 0.001 * (i % 997));
  expect_same(one_cell, "all points in one cell");
  PointScan borders;
  for (int y = -12; y <= 12; ++y)
    for (int x = -12; x <= 12; ++x) borders.Add(0.2 * x, 0.2 * y, 0.1 * ((x + y) & 3));
  expect_same(borders, "points on the borders of cells");
  PointScan highest;
  highest.Add(1.05, 1.05, 5).Add(-1.05, 1.05, 2).Add(-1.05, 1.05, 2);
  expect_same(highest, "cells that restart, and equal heights");
  PointScan negative(Pose<Odom, Base>::FromTranslation(-1000.1, -2000.3, -50), {});
  negative.AddCells({{-5013, -10014}, {-4989, -9990}}, 0.2,
                    [](double x, double) { return 0.1 * x + 50; });
  expect_same(negative, "negative coordinates, after a jump");
  PointScan seam(Pose<Odom, Base>::FromTranslation(-1001.9, -1998.4, -50), {});
  seam.Add(-1002.5, -1998.1, -50);
  expect_same(seam, "a move across the seam");
  PointScan huge(Pose<Odom, Base>::FromTranslation(999'999.9, -999'999.9, 900'000), {});
  huge.Add(999'998, -999'998, 900'000).AddAll({{3e38f, -3e38f, 3e38f, 0}, {1e-38f, 0, 0, 0}});
  expect_same(huge, "the far end of O");
  PointScan wall(Pose<Odom, Base>(), Pose<Base, Sensor>::FromTranslation(4, 3, 2));
  for (int i = 0; i < 900; ++i) wall.Add(2 - 0.004 * i, 2 - 0.0041 * (i % 800), 0.3 * (i % 7));
  expect_same(wall, "a sensor beside the window");
  PointScan rays(Pose<Odom, Base>(), Pose<Base, Sensor>::FromTranslation(4, 3, 2));
  for (int i = 0; i < 900; ++i) rays.Add(-3, 3 - 0.008 * i, 0);
  expect_same(rays, "rays across the window");
  EXPECT_GT(pair.cleared(), 0u);
  EXPECT_GT(pair.restarted(), 0u);
  EXPECT_EQ(pair.EvictAll(), "");
  EXPECT_EQ(pair.EvictAll(), "");
}

TEST(EmulatedCuda, AgreesWithCpuWhereverTheWindowMoves) {
  SetSeed(7);
  LocalMapOptions options = SmallWindow();
  options.side_m = 1.8f;
  Pair pair(options);
  std::uint64_t seq = 1;
  // By columns, by rows, both ways, nearly and altogether out of the window.
  const int kMoves[][2] = {{0, 0},  {1, 0}, {-2, 0}, {0, 3},   {0, -1}, {2, -3},
                           {-8, 8}, {9, 0}, {0, -9}, {-1, -1}, {50, 1}};
  int x = 0, y = 0;
  for (const auto& move : kMoves) {
    x += move[0];
    y += move[1];
    PointScan scan(Pose<Odom, Base>::FromTranslation(0.2 * x + 0.1, 0.2 * y + 0.1, 0), {});
    scan.AddCells({{x - 4, y - 4}, {x + 5, y + 5}}, 0.2,
                  [](double px, double py) { return -1 + 0.05 * px - 0.3 * py; });
    ASSERT_EQ(pair.Fuse(scan.At(seq++)), "") << "moved by " << move[0] << ", " << move[1];
  }
  EXPECT_GT(pair.evicted(), 0u);
}

TEST(EmulatedCuda, AgreesWithCpuOnARealScan) {
  const char* data = std::getenv("GEM_DATA_DIR");
  if (data == nullptr) GTEST_SKIP() << "set GEM_DATA_DIR to the unpacked KITTI data";
  std::ifstream file(std::filesystem::path(data) / "sequences/00/velodyne/000000.bin",
                     std::ios::binary);
  PointScan scan(1.73);
  scan.scan().noise = testing::LidarNoiseModel();
  std::vector<ScanPoint> points;
  float xyzi[4];
  // Every twelfth point: enough for dozens of blocks.
  for (int i = 0; file.read(reinterpret_cast<char*>(xyzi), sizeof(xyzi)); ++i)
    if (i % 12 == 0) points.push_back({xyzi[0], xyzi[1], xyzi[2], 0});
  ASSERT_GT(points.size(), 10'000u);
  scan.AddAll(points);
  SetSeed(8);
  Pair pair((LocalMapOptions()));
  for (std::uint64_t seq = 1; seq <= 2; ++seq) ASSERT_EQ(pair.Fuse(scan.At(seq)), "");
}

// A robot that drives by; scan i of any number.
void DriveBy(LocalMapper& mapper, int i, std::vector<EvictedCell>& evicted) {
  std::mt19937 random(static_cast<unsigned>(i % 3) + 1);
  std::normal_distribution<float> place_m(0, 1.5f);
  std::vector<ScanPoint> points(600);
  for (ScanPoint& p : points) {
    p.x_m = place_m(random);
    p.y_m = place_m(random);
    p.z_m = -1;
  }
  Scan scan;
  scan.seq = static_cast<std::uint64_t>(i + 1);
  scan.stamp_ns = i * std::int64_t{100'000'000};
  scan.T_O_B = Pose<Odom, Base>::FromTranslation(0.3 * i, 0.1 * i, 0);
  scan.noise = testing::LidarNoiseModel();
  scan.points = points;
  mapper.FuseScan(scan, evicted);
}

TEST(EmulatedCuda, DoesNotAllocateOnceBuffersHaveGrown) {
  auto mapper = *MakeCudaMapper(SmallWindow());
  std::vector<EvictedCell> evicted;
  LocalMap map;
  for (int i = 0; i < 6; ++i) {
    DriveBy(*mapper, i, evicted);
    mapper->CopyTo(map);
  }
  const int before = gpu::emulation::num_allocations();
  for (int i = 6; i < 12; ++i) {
    DriveBy(*mapper, i, evicted);
    mapper->CopyTo(map);
  }
  EXPECT_EQ(gpu::emulation::num_allocations(), before);
  EXPECT_GT(before, 0);
}

TEST(EmulatedCuda, ReportsWhatTheDeviceTook) {
  auto mapper = *MakeCudaMapper(SmallWindow());
  std::vector<EvictedCell> evicted;
  PointScan scan;
  scan.Add(1, 1, 0);
  const ScanReport report = mapper->FuseScan(scan.At(1), evicted);
  EXPECT_GT(report.seconds.measure, 0);
  EXPECT_GT(report.seconds.clear, 0);
  EXPECT_LT(report.seconds.total(), 60);
}

TEST(EmulatedCuda, WithoutADeviceThereIsNoMapper) {
  gpu::emulation::SetDeviceCount(0);
  EXPECT_EQ(CudaStatus().code(), absl::StatusCode::kUnavailable);
  EXPECT_EQ(MakeCudaMapper(SmallWindow()).status().code(), absl::StatusCode::kUnavailable);
  gpu::emulation::SetDeviceCount(1);
  EXPECT_TRUE(CudaStatus().ok());
}

TEST(EmulatedCuda, IsChosenWhereThereIsADevice) {
  const auto with_device = ChooseLocalBackend(LocalBackend::kAuto);
  EXPECT_EQ(with_device.backend, LocalBackend::kCuda);
  EXPECT_EQ(with_device.why_not_cuda, "");
  gpu::emulation::SetDeviceCount(0);
  for (const LocalBackend wanted : {LocalBackend::kAuto, LocalBackend::kCuda}) {
    const auto without = ChooseLocalBackend(wanted);
    EXPECT_EQ(without.backend, LocalBackend::kCpu);
    EXPECT_EQ(without.why_not_cuda, "no CUDA device: emulated");
  }
  EXPECT_EQ(ChooseLocalBackend(LocalBackend::kCpu).why_not_cuda, "");
  EXPECT_TRUE(MakeLocalMapper(LocalBackend::kAuto, SmallWindow()).ok());
  EXPECT_FALSE(MakeLocalMapper(LocalBackend::kCuda, SmallWindow()).ok());
  gpu::emulation::SetDeviceCount(1);
}

TEST(EmulatedCuda, WithoutMemoryThereIsNoMapper) {
  for (int mallocs = 0; mallocs < 5; ++mallocs) {
    gpu::emulation::FailMallocAfter(mallocs);
    EXPECT_EQ(MakeCudaMapper(SmallWindow()).status().code(), absl::StatusCode::kResourceExhausted);
  }
  gpu::emulation::FailMallocAfter(-1);
}

// After a failure the map is that of a cpu backend that begins with the scan in hand.
void ExpectStartsAnewOnCpu(LocalMapper& mapper, int i) {
  const std::unique_ptr<LocalMapper> fresh = MakeCpuMapper(SmallWindow(), 1);
  std::vector<EvictedCell> evicted, fresh_evicted;
  LocalMap map, fresh_map;
  for (; i < 6; ++i) {
    DriveBy(mapper, i, evicted);
    DriveBy(*fresh, i, fresh_evicted);
    mapper.CopyTo(map);
    fresh->CopyTo(fresh_map);
    EXPECT_EQ(BitDifferenceOf(fresh_map, map), "") << "scan " << i;
  }
  EXPECT_EQ(DifferenceOfEvicted(fresh_evicted, evicted), "");
}

TEST(EmulatedCuda, AScanThatFindsNoMemoryGoesToTheCpu) {
  auto mapper = *MakeCudaMapper(SmallWindow());
  gpu::emulation::FailMallocAfter(2);
  ExpectStartsAnewOnCpu(*mapper, 0);
  gpu::emulation::FailMallocAfter(-1);
}

TEST(EmulatedCuda, ADeviceThatFailsLosesTheMapButNotTheProcess) {
  auto mapper = *MakeCudaMapper(SmallWindow());
  std::vector<EvictedCell> evicted;
  for (int i = 0; i < 2; ++i) DriveBy(*mapper, i, evicted);
  gpu::emulation::FailNextKernel();
  ExpectStartsAnewOnCpu(*mapper, 2);
}

}  // namespace
}  // namespace gem
