// What only an emulated device can be asked: a short real scan, allocations, failures.
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <memory>
#include <random>

#include "tests/core/local/backend_pair.h"
#include "tests/core/local/scenes.h"
#include "tests/emulation/emulation.h"

namespace gem {
namespace testing {

void ShuffleThreads(unsigned seed) { gpu::emulation::SetSeed(seed); }

}  // namespace testing
namespace {

using testing::BitDifferenceOf;
using testing::DifferenceOfEvicted;
using testing::Pair;
using testing::PointScan;
using testing::ShuffleThreads;
using testing::SmallWindow;

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
  ShuffleThreads(8);
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
