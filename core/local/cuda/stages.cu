#include "core/local/cuda/stages.h"

#include "core/gpu/launch.h"
#include "core/local/annotate.h"
#include "core/local/cuda/ordered_float.h"

namespace gem::cuda {
namespace {

constexpr std::uint32_t kThreads = 128;
// A row of a tile is a warp, so that neighbouring lanes read neighbouring cells.
constexpr std::uint32_t kTileColumns = 32, kTileRows = 8;
constexpr std::uint32_t kHalo = static_cast<std::uint32_t>(kPlaneRadius_cells);
constexpr std::uint32_t kHaloColumns = kTileColumns + 2 * kHalo;
constexpr std::uint32_t kHaloRows = kTileRows + 2 * kHalo;
constexpr std::uint32_t kHaloCells = kHaloColumns * kHaloRows;

// ---- counting: in the block first, since atomics on one address of global memory wait for each
// other. All threads of the block take part.

GEM_DEVICE inline std::uint32_t* BeginCounting() {
  auto* counts = static_cast<std::uint32_t*>(gpu::SharedBytes());
  if (gpu::ThreadIndex().x < kNumCounters) counts[gpu::ThreadIndex().x] = 0;
  gpu::SyncThreads();
  return counts;
}
GEM_DEVICE inline void EndCounting(const std::uint32_t* counts, std::uint32_t* counters) {
  gpu::SyncThreads();
  const std::uint32_t thread = gpu::ThreadIndex().x;
  if (thread < kNumCounters && counts[thread] != 0) {
    gpu::AtomicAdd(&counters[thread], counts[thread]);
  }
}
constexpr std::size_t kCountingBytes = kNumCounters * sizeof(std::uint32_t);

// ---- layers

GEM_DEVICE inline bool IsKnown(const DeviceLayers& layers, std::uint32_t slot) {
  return (layers.state[slot] & kCellKnown) != 0;
}

GEM_DEVICE inline void StoreAnnotation(const DeviceLayers& layers, std::uint32_t slot,
                                       const Annotation& annotation) {
  layers.state[slot] = static_cast<std::uint8_t>((layers.state[slot] & ~kCellAnnotated) |
                                                 (annotation.valid ? kCellAnnotated : 0));
  layers.slope_rad[slot] = annotation.slope_rad;
  layers.roughness_m[slot] = annotation.roughness_m;
  layers.traversability[slot] = annotation.traversability;
}

GEM_DEVICE inline void Forget(const DeviceLayers& layers, std::uint32_t slot) {
  layers.elevation_m[slot] = layers.variance_m2[slot] = 0;
  layers.rgba[slot] = 0;
  layers.observed_ns[slot] = 0;
  StoreAnnotation(layers, slot, Annotation());
  layers.state[slot] = 0;
}

// ---- move

GEM_KERNEL FlagLeaving(DeviceLayers layers, DeviceWindow window, LeavingPlaces leaving,
                       std::uint32_t* flags) {
  const std::uint32_t i = gpu::GlobalIndex();
  if (i >= leaving.count()) return;
  flags[i] = IsKnown(layers, window.SlotOf(leaving.At(i))) ? 1 : 0;
}

GEM_KERNEL EvictLeaving(DeviceLayers layers, DeviceWindow window, LeavingPlaces leaving,
                        const std::uint32_t* offsets, EvictedCell* evicted,
                        std::uint32_t* counters) {
  const std::uint32_t i = gpu::GlobalIndex();
  if (i >= leaving.count()) return;
  const Place place = leaving.At(i);
  const std::uint32_t slot = window.SlotOf(place);
  const bool known = IsKnown(layers, slot);
  if (i == leaving.count() - 1) counters[kEvicted] = offsets[i] + (known ? 1 : 0);
  if (!known) return;
  EvictedCell& cell = evicted[offsets[i]];
  cell.cell = {window.origin.x + place.column, window.origin.y + place.row};
  cell.belief = {layers.elevation_m[slot], layers.variance_m2[slot], layers.traversability[slot],
                 layers.rgba[slot],        layers.observed_ns[slot], layers.state[slot]};
  Forget(layers, slot);
}

GEM_KERNEL GrowVariances(float* variance_m2, std::uint32_t num_cells, float growth_m2,
                         FuseLimits limits) {
  const std::uint32_t slot = gpu::GlobalIndex();
  // Zero says unknown here: a known cell has at least the floor, which is above zero.
  if (slot >= num_cells || !(variance_m2[slot] > 0.0f)) return;
  variance_m2[slot] = GrowVariance(variance_m2[slot], growth_m2, limits);
}

// ---- measure

GEM_DEVICE inline void AddRay(const DeviceRays& rays, const Beam& beam) {
  const Ray ray = RayTo(beam.x_m, beam.y_m, beam.z_m, rays.bins);
  const std::int32_t range_bin = ray.range_bin < rays.limit ? ray.range_bin : rays.limit;
  if (range_bin == 0) return;
  gpu::AtomicMin(&rays.slopes[range_bin * rays.bins.azimuth + ray.azimuth_bin],
                 OrderedFrom(ray.slope));
}

GEM_KERNEL MeasurePoints(ScanFrame frame, DeviceRays rays, DeviceScan scan) {
  std::uint32_t* fates = BeginCounting();
  const std::uint32_t i = gpu::GlobalIndex();
  if (i < scan.num_points) {
    const ScanPoint p_S = scan.points[i];
    const Beam beam = MeasureBeam(frame, p_S);
    gpu::AtomicAdd(&fates[kFates + static_cast<std::uint32_t>(beam.fate)], 1);
    if (RayCounts(beam.fate)) AddRay(rays, beam);
    const bool in_window = beam.fate == PointFate::kInWindow;
    const std::int32_t side = frame.side_cells;
    scan.keys[i] =
        in_window ? static_cast<std::uint32_t>(beam.row * side + beam.column) : gpu::kNoKey;
    if (in_window) {
      scan.hits[i] = {{ElevationOf(frame, beam), SensorVarianceOf(frame, p_S, beam)}, p_S.rgba};
    }
  }
  EndCounting(fates, scan.counters);
}

// ---- fuse

// Where the runs of equal keys begin and end; hits in the order of the keys.
GEM_KERNEL FindRuns(DeviceScan scan) {
  const std::uint32_t i = gpu::GlobalIndex();
  const std::uint32_t num_hits = *scan.num_hits;
  if (i >= num_hits) return;
  const std::uint32_t key = scan.keys[i];
  scan.sorted_hits[i] = scan.hits[scan.positions[i]];
  if (i == 0 || scan.keys[i - 1] != key) scan.runs[key].begin = i;
  if (i + 1 == num_hits || scan.keys[i + 1] != key) scan.runs[key].end = i + 1;
}

// Fuses the scan's points over a cell into it.
GEM_DEVICE inline FuseOutcome FuseInto(const DeviceLayers& layers, std::uint32_t slot, Place place,
                                       const FuseTask& task, const Hit* hits, std::uint32_t count) {
  CellFusion cell;
  if (IsKnown(layers, slot)) {
    cell = UnpackCell({layers.elevation_m[slot], layers.variance_m2[slot]}, layers.rgba[slot]);
  }
  // Zero where it is not annotated, and the limit is above zero: unknown is never free.
  const bool is_free = layers.traversability[slot] > task.traversability_free;
  const FuseOutcome outcome =
      FuseCell(cell, hits, count, is_free, PoseVarianceOfCell(task.frame, place.column, place.row),
               task.limits);
  layers.elevation_m[slot] = cell.height.elevation_m;
  layers.variance_m2[slot] = cell.height.variance_m2;
  layers.rgba[slot] = PackColor(cell);
  layers.state[slot] = static_cast<std::uint8_t>(
      kCellKnown | (layers.state[slot] & kCellAnnotated) | (cell.colored ? kCellColored : 0));
  if (outcome.fused > 0) layers.observed_ns[slot] = task.stamp_ns;
  return outcome;
}

// A warp a cell: its lanes bring the hits near, then one fuses them in their order. The fullest
// cell decides how long it all takes, and from far each of its hits would cost a trip to memory.
constexpr std::uint32_t kFuseCells = kThreads / gpu::kWarpLanes;  // a block
constexpr std::uint32_t kNearHits = 512;  // a cell, as a pole gathers; one with more reads from far
constexpr std::size_t kFuseBytes = kCountingBytes + kFuseCells * kNearHits * sizeof(Hit);

GEM_DEVICE inline const Hit* BringNear(const DeviceScan& scan, const CellRun& run, Hit* near) {
  const Hit* const hits = scan.sorted_hits + run.begin;
  const std::uint32_t count = run.end - run.begin;
  if (count > kNearHits) return hits;
  for (std::uint32_t i = gpu::ThreadIndex().x % gpu::kWarpLanes; i < count; i += gpu::kWarpLanes) {
    near[i] = hits[i];
  }
  return near;
}

GEM_KERNEL FuseCells(DeviceLayers layers, DeviceWindow window, FuseTask task, DeviceScan scan) {
  std::uint32_t* counts = BeginCounting();
  const std::uint32_t warp = gpu::ThreadIndex().x / gpu::kWarpLanes;
  const std::uint32_t index = gpu::BlockIndex().x * kFuseCells + warp;
  const bool is_cell = index < window.num_cells();
  const CellRun run = is_cell ? scan.runs[index] : CellRun{0, 0};
  const Hit* const hits =
      BringNear(scan, run, reinterpret_cast<Hit*>(counts + kNumCounters) + warp * kNearHits);
  gpu::SyncThreads();
  if (is_cell && gpu::ThreadIndex().x % gpu::kWarpLanes == 0) {
    bool changed = false;
    if (run.begin != run.end) {
      const Place place = window.PlaceOf(index);
      const FuseOutcome outcome =
          FuseInto(layers, window.SlotOf(place), place, task, hits, run.end - run.begin);
      changed = outcome.fused > 0;
      gpu::AtomicAdd(&counts[kFused], outcome.fused);
      gpu::AtomicAdd(&counts[kGated], outcome.gated);
      if (outcome.restarted) gpu::AtomicAdd(&counts[kRestarted], 1);
      if (outcome.inflated) gpu::AtomicAdd(&counts[kInflated], 1);
    }
    scan.changed[index] = changed ? 1 : 0;
  }
  EndCounting(counts, scan.counters);
}

// ---- annotate

// A tile of the window and a rim around it, in shared memory. Known is what has a variance: state
// is written while neighbours are read.
struct HaloTile {
  ColumnSums* columns;  // by row of the tile, then column of the halo
  float* elevation_m;   // by row and column of the halo, as the rest
  std::uint8_t* known;
  std::uint8_t* changed;
};
constexpr std::size_t kColumnsBytes = kTileRows * kHaloColumns * sizeof(ColumnSums);
constexpr std::size_t kHaloBytes = kColumnsBytes + kHaloCells * (sizeof(float) + 2);

GEM_DEVICE inline std::uint32_t ThreadInTile() {
  return gpu::ThreadIndex().y * kTileColumns + gpu::ThreadIndex().x;
}
constexpr std::uint32_t kTileThreads = kTileColumns * kTileRows;

GEM_DEVICE inline HaloTile LoadTile(const DeviceLayers& layers, const DeviceWindow& window,
                                    const std::uint8_t* changed) {
  auto* bytes = static_cast<std::uint8_t*>(gpu::SharedBytes());
  auto* elevation_m = reinterpret_cast<float*>(bytes + kColumnsBytes);
  auto* known = bytes + kColumnsBytes + kHaloCells * sizeof(float);
  const HaloTile tile{static_cast<ColumnSums*>(gpu::SharedBytes()), elevation_m, known,
                      known + kHaloCells};
  for (std::uint32_t i = ThreadInTile(); i < kHaloCells; i += kTileThreads) {
    const Place place{
        static_cast<std::int32_t>(gpu::BlockIndex().x * kTileColumns + i % kHaloColumns) -
            kPlaneRadius_cells,
        static_cast<std::int32_t>(gpu::BlockIndex().y * kTileRows + i / kHaloColumns) -
            kPlaneRadius_cells};
    tile.elevation_m[i] = 0;
    tile.known[i] = tile.changed[i] = 0;
    if (!window.Contains(place)) continue;
    const std::uint32_t slot = window.SlotOf(place);
    tile.elevation_m[i] = layers.elevation_m[slot];
    tile.known[i] = layers.variance_m2[slot] > 0.0f ? 1 : 0;
    tile.changed[i] = changed[window.IndexOf(place)];
  }
  gpu::SyncThreads();
  return tile;
}

// Cells beside each other share columns: doubles are what most devices are slowest at.
GEM_DEVICE inline void SumColumns(const HaloTile& tile, double reference_m) {
  for (std::uint32_t i = ThreadInTile(); i < kTileRows * kHaloColumns; i += kTileThreads) {
    ColumnSums column;
    for (std::int32_t dy = -kPlaneRadius_cells; dy <= kPlaneRadius_cells; ++dy) {
      const std::uint32_t cell =
          i + static_cast<std::uint32_t>(dy + kPlaneRadius_cells) * kHaloColumns;
      column.Add(dy, tile.known[cell] != 0, tile.elevation_m[cell] - reference_m);
    }
    tile.columns[i] = column;
  }
  gpu::SyncThreads();
}

GEM_DEVICE inline bool AnyChangedAround(const HaloTile& tile, std::uint32_t lower_left) {
  std::uint32_t any_changed = 0;
  for (std::uint32_t dy = 0; dy <= 2 * kHalo; ++dy) {
    for (std::uint32_t dx = 0; dx <= 2 * kHalo; ++dx) {
      any_changed |= tile.changed[lower_left + dy * kHaloColumns + dx];
    }
  }
  return any_changed != 0;
}

GEM_KERNEL AnnotateCells(DeviceLayers layers, DeviceWindow window, LocalMapOptions options,
                         float reference_m, const std::uint8_t* changed) {
  const HaloTile tile = LoadTile(layers, window, changed);
  SumColumns(tile, static_cast<double>(reference_m));
  const gpu::Dim thread = gpu::ThreadIndex();
  const Place place{static_cast<std::int32_t>(gpu::BlockIndex().x * kTileColumns + thread.x),
                    static_cast<std::int32_t>(gpu::BlockIndex().y * kTileRows + thread.y)};
  // Of the neighbourhood; also the number of its leftmost column.
  const std::uint32_t lower_left = thread.y * kHaloColumns + thread.x;
  const std::uint32_t middle = lower_left + kHalo * kHaloColumns + kHalo;
  if (!window.Contains(place) || tile.known[middle] == 0) return;
  if (!AnyChangedAround(tile, lower_left)) return;
  PlaneSums sums;
  for (std::int32_t dx = -kPlaneRadius_cells; dx <= kPlaneRadius_cells; ++dx) {
    sums.Add(dx, tile.columns[lower_left + static_cast<std::uint32_t>(dx + kPlaneRadius_cells)]);
  }
  StoreAnnotation(layers, window.SlotOf(place), AnnotationOf(sums, options));
}

// ---- clear

// From here on a range bin holds the rays that end in it or later, and bin 0 all rays. The threads
// of a column of the block share the range bins of one azimuth bin: each takes the lowest of its
// own, then goes through them knowing what lies behind.
constexpr std::uint32_t kRayColumns = 32, kRayShares = 8;
constexpr std::size_t kRayBytes = kRayColumns * kRayShares * sizeof(std::uint32_t);

GEM_DEVICE inline std::uint32_t Lower(std::uint32_t a, std::uint32_t b) { return a < b ? a : b; }

GEM_KERNEL CompleteRays(DeviceRays rays) {
  auto* lowest = static_cast<std::uint32_t*>(gpu::SharedBytes());
  const gpu::Dim thread = gpu::ThreadIndex();
  const auto azimuth_bin = static_cast<std::int32_t>(gpu::BlockIndex().x * kRayColumns + thread.x);
  const bool is_bin = azimuth_bin < rays.bins.azimuth;
  const std::int32_t num_bins = is_bin ? rays.limit + 1 : 0;
  constexpr auto kShares = static_cast<std::int32_t>(kRayShares);
  const std::int32_t share = (num_bins + kShares - 1) / kShares;
  const std::int32_t begin = static_cast<std::int32_t>(thread.y) * share;
  const std::int32_t end = begin + share < num_bins ? begin + share : num_bins;
  std::uint32_t* const slopes = rays.slopes + azimuth_bin;

  std::uint32_t own = kNoFloat;
  for (std::int32_t bin = begin; bin < end; ++bin) {
    own = Lower(own, slopes[bin * rays.bins.azimuth]);
  }
  lowest[thread.y * kRayColumns + thread.x] = own;
  gpu::SyncThreads();
  std::uint32_t behind = kNoFloat;
  for (std::uint32_t other = thread.y + 1; other < kRayShares; ++other) {
    behind = Lower(behind, lowest[other * kRayColumns + thread.x]);
  }
  for (std::int32_t bin = end - 1; bin >= begin; --bin) {
    behind = Lower(behind, slopes[bin * rays.bins.azimuth]);
    slopes[bin * rays.bins.azimuth] = behind;
  }
}

// RayTable::AllPassBelow, on ordered integers.
GEM_DEVICE inline bool AllPassBelow(const DeviceRays& rays, const CellSight& sight,
                                    float sensor_z_m, float height_m) {
  if (sight.num_bins == 0 || sight.range_bin_min > rays.limit) return false;
  const std::uint32_t* crossing = rays.slopes + sight.range_bin_min * rays.bins.azimuth;
  bool crossed = false;
  for (std::int32_t i = 0; i < sight.num_bins; ++i) {
    const std::int32_t unwrapped = sight.first_bin + i;
    const std::int32_t bin =
        unwrapped < rays.bins.azimuth ? unwrapped : unwrapped - rays.bins.azimuth;
    if (rays.slopes[bin] == kNoFloat) continue;
    if (crossing[bin] == kNoFloat) return false;
    if (!(RayTopOver(sight, FloatFrom(crossing[bin]), sensor_z_m) < height_m)) return false;
    crossed = true;
  }
  return crossed;
}

GEM_DEVICE inline bool IsCleared(const DeviceLayers& layers, std::uint32_t slot, Place place,
                                 const LocalMapOptions& options, const ScanFrame& frame,
                                 const DeviceRays& rays) {
  const bool is_free = layers.traversability[slot] > options.traversability_free;
  const float height_m =
      ClearHeightOf(layers.elevation_m[slot], layers.variance_m2[slot], is_free, options);
  const CellSight sight =
      SightOf(static_cast<float>(place.column) * options.cell_size_m - frame.sensor_x_m,
              static_cast<float>(place.row) * options.cell_size_m - frame.sensor_y_m, rays.bins);
  return AllPassBelow(rays, sight, frame.sensor_z_m, height_m);
}

// On entry `changed` says which cells a point of this scan confirmed; on return, which are cleared.
GEM_KERNEL ClearCells(DeviceLayers layers, DeviceWindow window, LocalMapOptions options,
                      FuseTask task, DeviceRays rays, DeviceScan scan) {
  std::uint32_t* counts = BeginCounting();
  const std::uint32_t index = gpu::GlobalIndex();
  if (index < window.num_cells()) {
    const Place place = window.PlaceOf(index);
    const std::uint32_t slot = window.SlotOf(place);
    const bool cleared = scan.changed[index] == 0 && IsKnown(layers, slot) &&
                         IsCleared(layers, slot, place, options, task.frame, rays);
    if (cleared) {
      Forget(layers, slot);
      gpu::AtomicAdd(&counts[kCleared], 1);
      const CellRun run = scan.runs[index];
      // The cell was not confirmed, so all its points were counted as gated.
      if (run.begin != run.end) {
        const FuseOutcome outcome =
            FuseInto(layers, slot, place, task, scan.sorted_hits + run.begin, run.end - run.begin);
        gpu::AtomicAdd(&counts[kFusedAgain], outcome.fused);
      }
    }
    scan.changed[index] = cleared ? 1 : 0;
  }
  EndCounting(counts, scan.counters);
}

}  // namespace

void EnqueueEvict(const DeviceLayers& layers, const DeviceWindow& window,
                  const LeavingPlaces& leaving, std::uint32_t* offsets, EvictedCell* evicted,
                  std::uint32_t* counters, gpu::Stream& stream) {
  const std::uint32_t blocks = gpu::BlocksOver(leaving.count(), kThreads);
  gpu::Launch(FlagLeaving, {blocks}, {kThreads}, 0, stream, layers, window, leaving, offsets);
  gpu::EnqueueExclusiveScan(offsets, leaving.count(), stream);
  gpu::Launch(EvictLeaving, {blocks}, {kThreads}, 0, stream, layers, window, leaving, offsets,
              evicted, counters);
}

void EnqueueGrow(const DeviceLayers& layers, std::uint32_t num_cells, float growth_m2,
                 const FuseLimits& limits, gpu::Stream& stream) {
  gpu::Launch(GrowVariances, {gpu::BlocksOver(num_cells, kThreads)}, {kThreads}, 0, stream,
              layers.variance_m2, num_cells, growth_m2, limits);
}

void EnqueueMeasure(const ScanFrame& frame, const DeviceRays& rays, const DeviceScan& scan,
                    gpu::Stream& stream) {
  // 0xff: kNoFloat.
  gpu::MemsetAsync(rays.slopes, 0xff,
                   static_cast<std::size_t>(rays.limit + 1) *
                       static_cast<std::size_t>(rays.bins.azimuth) * sizeof(std::uint32_t),
                   stream);
  if (scan.num_points == 0) return;
  gpu::Launch(MeasurePoints,
              {gpu::BlocksOver(static_cast<std::uint32_t>(scan.num_points), kThreads)}, {kThreads},
              kCountingBytes, stream, frame, rays, scan);
}

void EnqueueFuse(const DeviceLayers& layers, const DeviceWindow& window, const FuseTask& task,
                 const DeviceScan& scan, gpu::Stream& stream) {
  gpu::MemsetAsync(scan.runs, 0, window.num_cells() * sizeof(CellRun), stream);
  if (scan.num_points > 0) {
    gpu::Launch(FindRuns, {gpu::BlocksOver(static_cast<std::uint32_t>(scan.num_points), kThreads)},
                {kThreads}, 0, stream, scan);
  }
  gpu::Launch(FuseCells, {gpu::BlocksOver(window.num_cells(), kFuseCells)}, {kThreads}, kFuseBytes,
              stream, layers, window, task, scan);
}

void EnqueueAnnotate(const DeviceLayers& layers, const DeviceWindow& window,
                     const LocalMapOptions& options, float reference_m, const std::uint8_t* changed,
                     gpu::Stream& stream) {
  const auto side = static_cast<std::uint32_t>(window.side_cells);
  gpu::Launch(
      AnnotateCells, {gpu::BlocksOver(side, kTileColumns), gpu::BlocksOver(side, kTileRows)},
      {kTileColumns, kTileRows}, kHaloBytes, stream, layers, window, options, reference_m, changed);
}

void EnqueueClear(const DeviceLayers& layers, const DeviceWindow& window,
                  const LocalMapOptions& options, const FuseTask& task, const DeviceRays& rays,
                  const DeviceScan& scan, gpu::Stream& stream) {
  const auto azimuth = static_cast<std::uint32_t>(rays.bins.azimuth);
  gpu::Launch(CompleteRays, {gpu::BlocksOver(azimuth, kRayColumns)}, {kRayColumns, kRayShares},
              kRayBytes, stream, rays);
  gpu::Launch(ClearCells, {gpu::BlocksOver(window.num_cells(), kThreads)}, {kThreads},
              kCountingBytes, stream, layers, window, options, task, rays, scan);
}

}  // namespace gem::cuda
