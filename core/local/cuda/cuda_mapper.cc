#include "core/local/cuda/cuda_mapper.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdio>

#include "core/base/stopwatch.h"
#include "core/gpu/buffer.h"
#include "core/gpu/radix_sort.h"
#include "core/local/cpu_mapper.h"
#include "core/local/cuda/device_map.h"
#include "core/local/cuda/stages.h"
#include "core/local/ring_window.h"

namespace gem {
namespace cuda {

LeavingPlaces LeavingAfter(std::int32_t shift_x, std::int32_t shift_y, std::int32_t side_cells) {
  LeavingPlaces leaving{side_cells, std::clamp(shift_y, 0, side_cells),
                        std::clamp(side_cells + shift_y, 0, side_cells),
                        std::clamp(shift_x, 0, side_cells),
                        std::clamp(side_cells + shift_x, 0, side_cells)};
  if (leaving.row_begin >= leaving.row_end || leaving.column_begin >= leaving.column_end) {
    leaving.row_begin = leaving.row_end = 0;  // nothing stays
  }
  return leaving;
}

namespace {

using gpu::DeviceBuffer;
using gpu::PinnedBuffer;

// Marks between the stages.
enum Mark { kBegin, kMoved, kMeasured, kFusedAll, kAnnotated, kEnd };

class LayerBuffers {
 public:
  absl::Status Create(std::size_t num_cells, gpu::Stream& stream) {
    absl::Status status;
    ForEach([&](auto& layer, auto& /*host*/) {
      if (status.ok()) status = layer.Grow(num_cells);
      if (!status.ok()) return;
      gpu::MemsetAsync(layer.data(), 0, num_cells * sizeof(*layer.data()), stream);
    });
    return status;
  }

  DeviceLayers device() const {
    return {state_.data(),       elevation_m_.data(),    variance_m2_.data(), slope_rad_.data(),
            roughness_m_.data(), traversability_.data(), rgba_.data(),        observed_ns_.data()};
  }

  /// Brings all layers to the host, then has copy(layer of the map, its values by slot) for each.
  template <typename Copy>
  absl::Status Download(std::size_t num_cells, LocalMap& map, gpu::Stream& stream, Copy copy) {
    absl::Status status;
    ForEach([&](auto& layer, auto& host) {
      if (status.ok()) status = host.Grow(num_cells);
      if (!status.ok()) return;
      gpu::MemcpyToHostAsync(host.data(), layer.data(), num_cells * sizeof(*layer.data()), stream);
    });
    GEM_RETURN_IF_ERROR(status);
    GEM_RETURN_IF_ERROR(gpu::StreamSynchronize(stream));
    copy(map.state, host_.state.data());
    copy(map.elevation_m, host_.elevation_m.data());
    copy(map.variance_m2, host_.variance_m2.data());
    copy(map.slope_rad, host_.slope_rad.data());
    copy(map.roughness_m, host_.roughness_m.data());
    copy(map.traversability, host_.traversability.data());
    copy(map.rgba, host_.rgba.data());
    copy(map.observed_ns, host_.observed_ns.data());
    return absl::OkStatus();
  }

 private:
  template <typename Use>
  void ForEach(Use use) {
    use(state_, host_.state);
    use(elevation_m_, host_.elevation_m);
    use(variance_m2_, host_.variance_m2);
    use(slope_rad_, host_.slope_rad);
    use(roughness_m_, host_.roughness_m);
    use(traversability_, host_.traversability);
    use(rgba_, host_.rgba);
    use(observed_ns_, host_.observed_ns);
  }

  DeviceBuffer<std::uint8_t> state_;
  DeviceBuffer<float> elevation_m_, variance_m2_, slope_rad_, roughness_m_, traversability_;
  DeviceBuffer<Rgba> rgba_;
  DeviceBuffer<std::int64_t> observed_ns_;
  struct {
    PinnedBuffer<std::uint8_t> state;
    PinnedBuffer<float> elevation_m, variance_m2, slope_rad, roughness_m, traversability;
    PinnedBuffer<Rgba> rgba;
    PinnedBuffer<std::int64_t> observed_ns;
  } host_;  // grown when somebody reads for the first time
};

struct CloseStream {
  void operator()(gpu::Stream* stream) const { gpu::StreamDestroy(stream); }
};

class CudaMapper final : public LocalMapper {
 public:
  explicit CudaMapper(const LocalMapOptions& options)
      : options_(options),
        limits_(FuseLimitsOf(options)),
        bins_(RayBinsOf(SideCells(options), options.cell_size_m)),
        window_(WindowAt({0, 0}, SideCells(options))) {}

  absl::Status Create();
  ScanReport FuseScan(const Scan& scan, std::vector<EvictedCell>& evicted) override;
  void CopyTo(LocalMap& map) const override;
  void EvictAll(std::vector<EvictedCell>& evicted) override;

 private:
  absl::Status Enqueue(const Scan& scan);
  absl::Status Upload(const Scan& scan);
  absl::Status EnqueueLeaving(const LeavingPlaces& leaving);
  void EnqueueStages(const Scan& scan, float growth_m2);
  absl::Status Finish(std::vector<EvictedCell>& evicted);
  ScanReport ReportOf(std::size_t num_points) const;
  DeviceRays RaysOver(const ScanFrame& frame) const;

  // Constant after construction.
  const LocalMapOptions options_;
  const FuseLimits limits_;
  const RayBins bins_;

  std::unique_ptr<LocalMapper> fallback_;  // set once the device has failed
  // Declared before the buffers: closed after they are freed.
  std::unique_ptr<gpu::Stream, CloseStream> stream_;

  // The map.
  DeviceWindow window_;
  mutable LayerBuffers layers_;
  bool placed_ = false;
  std::uint64_t seq_ = 0;
  std::int64_t stamp_ns_ = 0;
  Pose<Odom, Base> T_O_B_;

  // Of the scan in hand.
  PinnedBuffer<ScanPoint> pinned_points_;
  DeviceBuffer<ScanPoint> points_;
  DeviceBuffer<Hit> hits_, sorted_hits_;
  gpu::SortBuffers sort_;
  DeviceBuffer<CellRun> runs_;
  DeviceBuffer<std::uint8_t> changed_;
  DeviceBuffer<std::uint32_t> slopes_;
  DeviceBuffer<std::uint32_t> counters_;
  PinnedBuffer<std::uint32_t> pinned_counters_;
  DeviceBuffer<std::uint32_t> evicted_offsets_;
  DeviceBuffer<EvictedCell> evicted_;
  PinnedBuffer<EvictedCell> pinned_evicted_;
};

absl::Status CudaMapper::Create() {
  GEM_RETURN_IF_ERROR(gpu::DeviceStatus());
  GEM_ASSIGN_OR_RETURN(gpu::Stream* const stream, gpu::StreamCreate());
  stream_.reset(stream);
  const std::size_t num_cells = window_.num_cells();
  GEM_RETURN_IF_ERROR(layers_.Create(num_cells, *stream_));
  GEM_RETURN_IF_ERROR(runs_.Grow(num_cells));
  GEM_RETURN_IF_ERROR(changed_.Grow(num_cells));
  GEM_RETURN_IF_ERROR(slopes_.Grow(static_cast<std::size_t>(bins_.azimuth) *
                                   static_cast<std::size_t>(bins_.range)));
  GEM_RETURN_IF_ERROR(counters_.Grow(kNumCounters));
  GEM_RETURN_IF_ERROR(pinned_counters_.Grow(kNumCounters));
  return gpu::StreamSynchronize(*stream_);
}

absl::Status CudaMapper::Upload(const Scan& scan) {
  const std::size_t num_points = scan.num_points();
  if (num_points == 0) return absl::OkStatus();
  GEM_RETURN_IF_ERROR(pinned_points_.Grow(num_points));
  GEM_RETURN_IF_ERROR(points_.Grow(num_points));
  GEM_RETURN_IF_ERROR(hits_.Grow(num_points));
  GEM_RETURN_IF_ERROR(sorted_hits_.Grow(num_points));
  GEM_RETURN_IF_ERROR(sort_.Grow(static_cast<std::uint32_t>(num_points)));
  // The scan before this one was waited for, so nothing reads the pinned points any more. In
  // pieces: while one is on its way, the next is copied, or decoded if it is packed.
  constexpr std::size_t kPiecePoints = 32768;
  for (std::size_t begin = 0; begin < num_points; begin += kPiecePoints) {
    const std::size_t end = std::min(begin + kPiecePoints, num_points);
    ScanPoint* const piece = pinned_points_.data() + begin;
    if (scan.packed.count != 0) {
      for (std::size_t i = begin; i < end; ++i) piece[i - begin] = PointAt(scan.packed, i);
    } else {
      std::copy(scan.points.begin() + static_cast<std::ptrdiff_t>(begin),
                scan.points.begin() + static_cast<std::ptrdiff_t>(end), piece);
    }
    gpu::MemcpyToDeviceAsync(points_.data() + begin, piece, (end - begin) * sizeof(ScanPoint),
                             *stream_);
  }
  return absl::OkStatus();
}

absl::Status CudaMapper::EnqueueLeaving(const LeavingPlaces& leaving) {
  const std::uint32_t count = leaving.count();
  if (count == 0) return absl::OkStatus();
  GEM_RETURN_IF_ERROR(evicted_offsets_.Grow(count));
  GEM_RETURN_IF_ERROR(evicted_.Grow(count));
  GEM_RETURN_IF_ERROR(pinned_evicted_.Grow(count));
  EnqueueEvict(layers_.device(), window_, leaving, evicted_offsets_.data(), evicted_.data(),
               counters_.data(), *stream_);
  // All that may have left, since only the device knows how many cells it is: no wait for that.
  gpu::MemcpyToHostAsync(pinned_evicted_.data(), evicted_.data(), count * sizeof(EvictedCell),
                         *stream_);
  return absl::OkStatus();
}

// The range bins that a window asks for from where the sensor is.
DeviceRays CudaMapper::RaysOver(const ScanFrame& frame) const {
  const float span_m = static_cast<float>(window_.side_cells) * options_.cell_size_m;
  const float far_x_m = std::max(std::fabs(frame.sensor_x_m), std::fabs(span_m - frame.sensor_x_m));
  const float far_y_m = std::max(std::fabs(frame.sensor_y_m), std::fabs(span_m - frame.sensor_y_m));
  const float far_m = std::sqrt(far_x_m * far_x_m + far_y_m * far_y_m);
  // One bin more than the farthest corner asks for, as its distance is rounded here and there.
  return {bins_, std::min(RangeBinOf(far_m, bins_) + 2, bins_.range - 1), slopes_.data()};
}

void CudaMapper::EnqueueStages(const Scan& scan, float growth_m2) {
  const ScanFrame frame = MakeScanFrame(scan, window_.origin, options_);
  const FuseTask task{scan.stamp_ns, frame, limits_, options_.traversability_free};
  const DeviceRays rays = RaysOver(frame);
  const DeviceLayers layers = layers_.device();
  DeviceScan device{points_.data(),    scan.num_points(), sort_.keys(),        sort_.positions(),
                    sort_.num_items(), hits_.data(),      sorted_hits_.data(), runs_.data(),
                    changed_.data(),   counters_.data()};
  if (growth_m2 != 0.0f) EnqueueGrow(layers, window_.num_cells(), growth_m2, limits_, *stream_);
  gpu::MarkAsync(kMoved, *stream_);
  EnqueueMeasure(frame, rays, device, *stream_);
  gpu::MarkAsync(kMeasured, *stream_);
  if (device.num_points > 0) {
    const auto key_bits = static_cast<std::uint32_t>(std::bit_width(window_.num_cells() - 1));
    sort_.EnqueueSort(static_cast<std::uint32_t>(device.num_points), key_bits, *stream_);
    device.keys = sort_.keys();
    device.positions = sort_.positions();
  }
  EnqueueFuse(layers, window_, task, device, *stream_);
  gpu::MarkAsync(kFusedAll, *stream_);
  EnqueueAnnotate(layers, window_, options_, frame.sensor_z_m, device.changed, *stream_);
  gpu::MarkAsync(kAnnotated, *stream_);
  EnqueueClear(layers, window_, options_, task, rays, device, *stream_);
  EnqueueAnnotate(layers, window_, options_, frame.sensor_z_m, device.changed, *stream_);
  gpu::MarkAsync(kEnd, *stream_);
}

absl::Status CudaMapper::Enqueue(const Scan& scan) {
  const Eigen::Vector3d& base = scan.T_O_B.translation();
  const CellIndex to = WindowOriginAt(base.x(), base.y(), options_.cell_size_m, window_.side_cells);
  if (!placed_) window_ = WindowAt(to, window_.side_cells);
  placed_ = true;
  gpu::MarkAsync(kBegin, *stream_);
  gpu::MemsetAsync(counters_.data(), 0, kNumCounters * sizeof(std::uint32_t), *stream_);
  GEM_RETURN_IF_ERROR(Upload(scan));
  GEM_RETURN_IF_ERROR(EnqueueLeaving(
      LeavingAfter(to.x - window_.origin.x, to.y - window_.origin.y, window_.side_cells)));
  window_ = WindowAt(to, window_.side_cells);

  const double way_m = (base - T_O_B_.translation()).norm();
  const float growth_m2 = GrowthOver(stamp_ns_, scan.stamp_ns, way_m, options_);
  seq_ = scan.seq;
  stamp_ns_ = scan.stamp_ns;
  T_O_B_ = scan.T_O_B;
  EnqueueStages(scan, growth_m2);
  return absl::OkStatus();
}

// Waits for the device, and takes what left the map.
absl::Status CudaMapper::Finish(std::vector<EvictedCell>& evicted) {
  gpu::MemcpyToHostAsync(pinned_counters_.data(), counters_.data(),
                         kNumCounters * sizeof(std::uint32_t), *stream_);
  GEM_RETURN_IF_ERROR(gpu::StreamSynchronize(*stream_));
  const EvictedCell* cells = pinned_evicted_.data();
  evicted.insert(evicted.end(), cells, cells + pinned_counters_.data()[kEvicted]);
  return absl::OkStatus();
}

ScanReport CudaMapper::ReportOf(std::size_t num_points) const {
  const std::uint32_t* counts = pinned_counters_.data();
  const auto fate = [counts](PointFate f) { return counts[kFates + static_cast<std::size_t>(f)]; };
  ScanReport report;
  report.points = num_points;
  report.points_out_of_range = fate(PointFate::kOutOfRange);
  report.points_on_body = fate(PointFate::kOnBody);
  report.points_out_of_height = fate(PointFate::kTooLow) + fate(PointFate::kTooHigh);
  report.points_outside_window = fate(PointFate::kOutsideWindow);
  report.points_fused = counts[kFused] + counts[kFusedAgain];
  report.points_gated = counts[kGated] - counts[kFusedAgain];
  report.cells_evicted = counts[kEvicted];
  report.cells_restarted = counts[kRestarted];
  report.cells_inflated = counts[kInflated];
  report.cells_cleared = counts[kCleared];
  report.seconds.move = gpu::ElapsedSeconds(kBegin, kMoved, *stream_);
  report.seconds.measure = gpu::ElapsedSeconds(kMoved, kMeasured, *stream_);
  report.seconds.fuse = gpu::ElapsedSeconds(kMeasured, kFusedAll, *stream_);
  report.seconds.annotate = gpu::ElapsedSeconds(kFusedAll, kAnnotated, *stream_);
  report.seconds.clear = gpu::ElapsedSeconds(kAnnotated, kEnd, *stream_);
  return report;
}

ScanReport CudaMapper::FuseScan(const Scan& scan, std::vector<EvictedCell>& evicted) {
  if (fallback_ != nullptr) return fallback_->FuseScan(scan, evicted);
  Stopwatch stopwatch;
  absl::Status status = Enqueue(scan);
  if (status.ok()) status = Finish(evicted);
  if (!status.ok()) {
    // The map was on the device. Ending the process would take every other session's along.
    std::fprintf(stderr, "cuda backend: %s; the local map starts anew on the cpu backend\n",
                 std::string(status.message()).c_str());
    fallback_ = MakeCpuMapper(options_, /*threads=*/1);
    return fallback_->FuseScan(scan, evicted);
  }
  ScanReport report = ReportOf(scan.num_points());
  // What the host did, and waited for, beside the device's time: it belongs to the upload.
  report.seconds.move += std::max(0.0, stopwatch.Lap() - report.seconds.total());
  return report;
}

void CudaMapper::EvictAll(std::vector<EvictedCell>& evicted) {
  if (fallback_ != nullptr) return fallback_->EvictAll(evicted);
  gpu::MemsetAsync(counters_.data(), 0, kNumCounters * sizeof(std::uint32_t), *stream_);
  const std::int32_t side = window_.side_cells;
  absl::Status status = EnqueueLeaving(LeavingAfter(side, side, side));
  if (status.ok()) status = Finish(evicted);
  if (!status.ok()) {
    std::fprintf(stderr, "cuda backend: %s; the local map is lost\n",
                 std::string(status.message()).c_str());
  }
}

void CudaMapper::CopyTo(LocalMap& map) const {
  if (fallback_ != nullptr) return fallback_->CopyTo(map);
  map.stamp_ns = stamp_ns_;
  map.seq = seq_;
  map.T_O_B = T_O_B_;
  map.origin = window_.origin;
  map.side_cells = window_.side_cells;
  map.cell_size_m = options_.cell_size_m;
  map.traversability_free = options_.traversability_free;
  map.ResizeLayers(window_.num_cells());
  const std::int32_t side = window_.side_cells;
  const std::int32_t seam = side - window_.start_column;
  const auto copy = [&](auto& to, const auto* by_slot) {
    // A row of the window is two runs of its row in the ring: from the seam on, and before it.
    for (std::int32_t row = 0; row < side; ++row) {
      auto* out = to.data() + row * side;
      std::copy_n(by_slot + window_.SlotOf({0, row}), seam, out);
      if (seam < side) std::copy_n(by_slot + window_.SlotOf({seam, row}), side - seam, out + seam);
    }
  };
  // A failure shows again in the next scan, which tells it; until then the map is unknown.
  if (!layers_.Download(window_.num_cells(), map, *stream_, copy).ok()) {
    map.ResizeLayers(0);
    map.ResizeLayers(window_.num_cells());
  }
}

}  // namespace
}  // namespace cuda

absl::Status CudaStatus() { return gpu::DeviceStatus(); }

absl::StatusOr<std::unique_ptr<LocalMapper>> MakeCudaMapper(const LocalMapOptions& options) {
  auto mapper = std::make_unique<cuda::CudaMapper>(options);
  GEM_RETURN_IF_ERROR(mapper->Create());
  return mapper;
}

}  // namespace gem
