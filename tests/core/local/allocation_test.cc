// A scan allocates nothing once buffers have grown. Its own binary: it counts operator new.
#include <gtest/gtest.h>

#include <atomic>
#include <cstdlib>
#include <new>
#include <random>

#include "core/local/local_mapper.h"
#include "tests/core/local/scenes.h"

namespace {
std::atomic<int> allocations{0};
}  // namespace

void* operator new(std::size_t size) {
  ++allocations;
  if (void* memory = std::malloc(size)) return memory;
  throw std::bad_alloc();
}
void* operator new(std::size_t size, std::align_val_t alignment) {
  ++allocations;
  const auto unit = static_cast<std::size_t>(alignment);
  if (void* memory = std::aligned_alloc(unit, (size + unit - 1) / unit * unit)) return memory;
  throw std::bad_alloc();
}
void operator delete(void* memory) noexcept { std::free(memory); }
void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }
void operator delete(void* memory, std::align_val_t) noexcept { std::free(memory); }
void operator delete(void* memory, std::size_t, std::align_val_t) noexcept { std::free(memory); }

namespace gem {
namespace {

// Scan i of a robot that drives through posts that come and go.
void Drive(LocalMapper& mapper, const std::vector<std::vector<ScanPoint>>& sweeps, int i,
           std::vector<EvictedCell>& evicted, LocalMap& map) {
  Scan scan;
  scan.seq = static_cast<std::uint64_t>(i + 1);
  scan.stamp_ns = i * std::int64_t{100'000'000};
  scan.T_O_B = Pose<Odom, Base>::FromTranslation(0.3 * i, 0.1 * i, 0);
  scan.T_B_S = Pose<Base, Sensor>::FromTranslation(0, 0, 1.7);
  scan.noise = testing::LidarNoiseModel();
  scan.points = sweeps[static_cast<std::size_t>(i) % sweeps.size()];
  evicted.clear();
  mapper.FuseScan(scan, evicted);
  mapper.CopyTo(map);
}

void ExpectNoAllocation(int threads) {
  std::mt19937 random(1);
  std::vector<std::vector<ScanPoint>> sweeps;
  for (int k = 0; k < 3; ++k) {
    testing::World world;
    world.boxes.push_back(testing::BoxOn(2.0 + 0.5 * k, 0.3 * k, 0.5, 1.7));
    testing::Lidar lidar;
    lidar.columns = 400;
    sweeps.push_back(lidar.Sweep(world, Pose<Odom, Sensor>::FromTranslation(0, 0, 1.7), random));
  }
  auto mapper = *MakeLocalMapper(LocalBackend::kCpu, LocalMapOptions(), threads);
  std::vector<EvictedCell> evicted;
  LocalMap map;
  for (int i = 0; i < 30; ++i) Drive(*mapper, sweeps, i, evicted, map);
  const int before = allocations;
  for (int i = 30; i < 90; ++i) Drive(*mapper, sweeps, i, evicted, map);
  EXPECT_EQ(allocations - before, 0);
  EXPECT_GT(before, 0) << "the counter counts";
}

TEST(CpuMapper, DoesNotAllocateOnceBuffersHaveGrown) {
  ExpectNoAllocation(1);
  ExpectNoAllocation(2);
}

}  // namespace
}  // namespace gem
