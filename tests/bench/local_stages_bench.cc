// The stages of the cpu local mapper one by one, for every set of vector instructions that the
// machine has. Over the first scan of GEM_DATA_DIR/sequences/00 (KITTI odometry), or a simulated
// one. Second argument: 0 is a window of 8x8 m at 0.2 m, 1 one of 16x16 m at 0.1 m.
#include <benchmark/benchmark.h>

#include <array>
#include <cstdlib>
#include <fstream>
#include <random>
#include <string>
#include <vector>

#include "core/base/check.h"
#include "core/local/cpu/fuse_lanes.h"
#include "core/local/cpu/hit_lanes.h"
#include "core/local/cpu/plane_rows.h"
#include "core/local/cpu/point_pass.h"
#include "core/local/cpu/sight_pass.h"
#include "core/local/local_mapper.h"
#include "gem/v1/types.pb.h"
#include "proto/wire/scan.h"
#include "tests/core/local/scenes.h"

namespace gem {
namespace {

std::vector<ScanPoint> ReadOrSimulate() {
  std::vector<ScanPoint> points;
  if (const char* data = std::getenv("GEM_DATA_DIR")) {
    std::ifstream file(std::string(data) + "/sequences/00/velodyne/000000.bin", std::ios::binary);
    float xyzi[4];
    while (file.read(reinterpret_cast<char*>(xyzi), sizeof(xyzi))) {
      points.push_back({xyzi[0], xyzi[1], xyzi[2], 0});
    }
  }
  if (!points.empty()) return points;
  std::mt19937 random(1);
  testing::World world;
  for (int i = 0; i < 12; ++i) world.boxes.push_back(testing::BoxOn(3 + i, 4 - i, 1, 2));
  testing::Lidar lidar;
  lidar.sigma_m = 0.02;
  return lidar.Sweep(world, Pose<Odom, Sensor>::FromTranslation(0, 0, 1.73), random);
}

const std::vector<ScanPoint>& Points() {
  static const std::vector<ScanPoint> points = ReadOrSimulate();
  return points;
}

LocalMapOptions OptionsOf(std::int64_t which) {
  LocalMapOptions options;
  options.side_m = which == 0 ? 8.0f : 16.0f;
  options.cell_size_m = which == 0 ? 0.2f : 0.1f;
  return options;
}

// A robot that stands, and what the stages work on.
struct Stand {
  explicit Stand(const benchmark::State& state)
      : set(static_cast<VectorSet>(state.range(0))),
        options(OptionsOf(state.range(1))),
        limits(FuseLimitsOf(options)),
        window(SideCells(options)),
        layers(window.num_cells()),
        bins(RayBinsOf(window.side_cells(), options.cell_size_m)),
        rays(bins),
        sectors{FullTurn(bins)},
        part(window.num_cells(), sectors[0]) {
    scan.T_B_S = Pose<Base, Sensor>::FromTranslation(0, 0, 1.73);
    scan.noise = testing::LidarNoiseModel();
    scan.points = Points();
    window.MoveTo(WindowOriginAt(0, 0, options.cell_size_m, window.side_cells()));
    frame = MakeScanFrame(scan, window.origin(), options);
    // Beyond the farthest corner, seen from the middle.
    rays.SetLimit(window.side_cells() * 3 / 4);
  }
  void Measure() {
    runs.Plan(set, frame, scan, bins, sectors);
    cpu::MeasureRuns({set, frame, scan, runs, {&hits, 1}, rays}, 0, part);
  }
  void Sort(cpu::HitLanes& lanes) {
    const auto num_cells = static_cast<std::uint32_t>(window.num_cells());
    lanes.Sort({&part, 1}, {&hits, 1}, 0, num_cells);
  }
  void FillLayers() {
    std::mt19937 random(1);
    std::normal_distribution<float> height_m(-1.7f, 0.1f);
    for (std::size_t slot = 0; slot < window.num_cells(); ++slot) {
      layers.state[slot] = kCellKnown;
      layers.elevation_m[slot] = height_m(random);
      layers.variance_m2[slot] = 1e-3f;
    }
  }

  const VectorSet set;
  const LocalMapOptions options;
  const FuseLimits limits;
  Scan scan;
  RingWindow window;
  cpu::Layers layers;
  const RayBins bins;
  RayTable rays;
  const std::array<AzimuthSector, 1> sectors;
  cpu::PointRuns runs{1};
  cpu::MeasuredPart part;
  cpu::HitRun hits;
  ScanFrame frame{};
};

void MeasurePoints(benchmark::State& state) {
  Stand stand(state);
  for (auto _ : state) stand.Measure();
  state.counters["hits"] = static_cast<double>(stand.part.num_hits);
  state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(Points().size()));
}

void SortHits(benchmark::State& state) {
  Stand stand(state);
  cpu::HitLanes hits(stand.window.num_cells());
  stand.Measure();
  const std::vector<std::uint32_t> counts = stand.part.count_of_cell;
  for (auto _ : state) {
    stand.part.count_of_cell = counts;  // sorting leaves them zero; the copy is timed as well
    stand.Sort(hits);
    hits.Clear();
  }
  state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(stand.part.num_hits));
}

void FuseLanes(benchmark::State& state) {
  Stand stand(state);
  cpu::HitLanes hits(stand.window.num_cells());
  stand.Measure();
  stand.Sort(hits);
  for (auto _ : state) {
    for (std::size_t group = 0; group < hits.num_groups(); ++group) {
      const std::size_t first = hits.FirstRankOf(group);
      cpu::LaneCells cells{};
      for (std::size_t lane = 0; lane < hits.kLanes && first + lane < hits.num_cells(); ++lane) {
        cells.count[lane] = static_cast<std::int32_t>(hits.CountOf(first + lane));
      }
      cpu::FuseLanes(stand.set, hits.HeightsOf(group), cells.count[0], stand.limits, cells);
      benchmark::DoNotOptimize(cells);
    }
  }
  state.counters["cells"] = static_cast<double>(hits.num_cells());
  state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(stand.part.num_hits));
}

void AnnotateAll(benchmark::State& state) {
  Stand stand(state);
  stand.FillLayers();
  cpu::PlaneRows planes(stand.window.side_cells());
  const std::vector<std::uint8_t> changed(stand.window.num_cells(), 1);
  for (auto _ : state) {
    planes.Annotate(stand.set, stand.window, 0, stand.options, changed, 0,
                    stand.window.side_cells(), stand.layers);
  }
  state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(stand.window.num_cells()));
}

void CompleteRays(benchmark::State& state) {
  Stand stand(state);
  stand.Measure();
  for (auto _ : state) {
    stand.rays.Reset(stand.sectors[0]);
    stand.rays.Complete(stand.set, stand.sectors[0]);
  }
}

void LookUpAll(benchmark::State& state) {
  Stand stand(state);
  stand.FillLayers();
  stand.Measure();
  stand.rays.Complete(stand.set, stand.sectors[0]);
  cpu::ClearCandidates candidates(stand.window.num_cells());
  for (std::size_t i = 0; i < stand.window.num_cells(); ++i) {
    const auto side = static_cast<std::size_t>(stand.window.side_cells());
    candidates.place[i] = {static_cast<std::int16_t>(i % side),
                           static_cast<std::int16_t>(i / side)};
    candidates.elevation_m[i] = stand.layers.elevation_m[i];
    candidates.variance_m2[i] = stand.layers.variance_m2[i];
  }
  candidates.count = stand.window.num_cells();
  std::vector<Place> cleared;
  cleared.reserve(stand.window.num_cells());
  for (auto _ : state) {
    cleared.clear();
    cpu::FindPassedBelow(stand.set, stand.rays, stand.frame, stand.options, candidates, cleared);
  }
  state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(stand.window.num_cells()));
}

// The next scan of a robot that drives 0.5 m between two.
void DriveOn(Scan& scan) {
  ++scan.seq;
  scan.stamp_ns += 100'000'000;
  scan.T_O_B = Pose<Odom, Base>::FromTranslation(0.5 * static_cast<double>(scan.seq % 1000), 0, 0);
}

// The whole mapper, with the widest vectors.
void FuseScan(benchmark::State& state) {
  auto mapper = *MakeLocalMapper(LocalBackend::kCpu, OptionsOf(state.range(0)));
  Scan scan;
  scan.T_B_S = Pose<Base, Sensor>::FromTranslation(0, 0, 1.73);
  scan.noise = testing::LidarNoiseModel();
  scan.points = Points();
  std::vector<EvictedCell> evicted;
  for (auto _ : state) {
    DriveOn(scan);
    evicted.clear();
    mapper->FuseScan(scan, evicted);
  }
  state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(Points().size()));
}

// From the wire's int16 to the map: decoded into points first (0), or in the first pass (1).
void FuseInt16(benchmark::State& state) {
  auto mapper = *MakeLocalMapper(LocalBackend::kCpu, OptionsOf(state.range(1)));
  v1::Scan message;
  message.set_stamp_ns(1);
  message.set_sensor("lidar");
  GEM_CHECK(wire::PointsToProtoInt16(Points(), 0.004, &message).ok());
  const auto form = static_cast<wire::PointForm>(state.range(0));
  wire::DecodedScan decoded;
  Scan scan;
  scan.T_B_S = Pose<Base, Sensor>::FromTranslation(0, 0, 1.73);
  scan.noise = testing::LidarNoiseModel();
  std::vector<EvictedCell> evicted;
  for (auto _ : state) {
    const wire::FieldPath field("scan");
    GEM_CHECK(wire::FromProto(message, wire::ScanLimits(), field, decoded, form).ok());
    scan.points = decoded.points;
    scan.packed = decoded.packed;
    DriveOn(scan);
    evicted.clear();
    mapper->FuseScan(scan, evicted);
  }
  state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(Points().size()));
}

void EverySet(benchmark::internal::Benchmark* bench) {
  for (const std::int64_t window : {0, 1}) {
    for (const VectorSet set : {VectorSet::kBaseline, VectorSet::kAvx2, VectorSet::kAvx512}) {
      if (IsSupported(set)) bench->Args({static_cast<std::int64_t>(set), window});
    }
  }
  bench->Unit(benchmark::kMicrosecond);
}

BENCHMARK(MeasurePoints)->Apply(EverySet);
BENCHMARK(SortHits)->Apply(EverySet);
BENCHMARK(FuseLanes)->Apply(EverySet);
BENCHMARK(AnnotateAll)->Apply(EverySet);
BENCHMARK(CompleteRays)->Apply(EverySet);
BENCHMARK(LookUpAll)->Apply(EverySet);
BENCHMARK(FuseScan)->Arg(0)->Arg(1)->Unit(benchmark::kMicrosecond);
BENCHMARK(FuseInt16)->ArgsProduct({{0, 1}, {0, 1}})->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace gem

BENCHMARK_MAIN();
