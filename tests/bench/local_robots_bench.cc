// Scans a second of several robots in one process, each with a mapper and a thread of its own, as
// the server runs them. First argument: 0 cpu, 1 cuda; second: 0 is a window of 8x8 m at 0.2 m, 1
// one of 16x16 m at 0.1 m. Over the scans of GEM_DATA_DIR/sequences/00 (KITTI odometry).
#include <benchmark/benchmark.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <memory>
#include <vector>

#include "core/local/local_mapper.h"
#include "tests/core/local/scenes.h"

namespace gem {
namespace {

std::vector<std::vector<ScanPoint>> ReadScans() {
  std::vector<std::vector<ScanPoint>> scans;
  const char* data = std::getenv("GEM_DATA_DIR");
  if (data == nullptr) return scans;
  for (const auto& entry :
       std::filesystem::directory_iterator(std::filesystem::path(data) / "sequences/00/velodyne")) {
    std::ifstream file(entry.path(), std::ios::binary);
    scans.emplace_back();
    float xyzi[4];
    while (file.read(reinterpret_cast<char*>(xyzi), sizeof(xyzi)))
      scans.back().push_back({xyzi[0], xyzi[1], xyzi[2], 0});
  }
  return scans;
}

void FuseScans(benchmark::State& state) {
  static const std::vector<std::vector<ScanPoint>> scans = ReadScans();
  if (scans.empty()) return state.SkipWithError("GEM_DATA_DIR names no recordings");
  LocalMapOptions options;
  options.side_m = state.range(1) == 0 ? 8.0f : 16.0f;
  options.cell_size_m = state.range(1) == 0 ? 0.2f : 0.1f;
  auto mapper =
      MakeLocalMapper(state.range(0) == 0 ? LocalBackend::kCpu : LocalBackend::kCuda, options);
  if (!mapper.ok()) return state.SkipWithError("there is no CUDA device");
  Scan scan;
  scan.T_B_S = Pose<Base, Sensor>::FromTranslation(0, 0, 1.73);
  scan.noise = testing::LidarNoiseModel();
  std::vector<EvictedCell> evicted;
  for (auto _ : state) {
    scan.points = scans[scan.seq % scans.size()];
    ++scan.seq;
    scan.stamp_ns += 100'000'000;
    scan.T_O_B = Pose<Odom, Base>::FromTranslation(0.9 * static_cast<double>(scan.seq), 0, 0);
    evicted.clear();
    (*mapper)->FuseScan(scan, evicted);
  }
  state.SetItemsProcessed(state.iterations());
}
BENCHMARK(FuseScans)
    ->ArgNames({"cuda", "fine"})
    ->ArgsProduct({{0, 1}, {0, 1}})
    ->ThreadRange(1, 16)
    ->UseRealTime()
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace gem

BENCHMARK_MAIN();
