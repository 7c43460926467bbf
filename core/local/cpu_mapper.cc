#include "core/local/cpu_mapper.h"

#include <algorithm>
#include <cmath>

#include "core/base/stopwatch.h"
#include "core/base/vector_set.h"
#include "core/local/clear.h"
#include "core/local/cpu/fuse_lanes.h"
#include "core/local/cpu/hit_lanes.h"
#include "core/local/cpu/layers.h"
#include "core/local/cpu/plane_rows.h"
#include "core/local/cpu/point_pass.h"
#include "core/local/cpu/sight_pass.h"
#include "core/local/fuse.h"
#include "core/local/measure.h"
#include "core/local/ring_window.h"

namespace gem {
namespace {

using cpu::HitLanes;
using cpu::LaneCells;
using cpu::Layers;
using cpu::MeasuredPart;
using cpu::Place;

class CpuMapper final : public LocalMapper {
 public:
  explicit CpuMapper(const LocalMapOptions& options)
      : options_(options),
        limits_(FuseLimitsOf(options)),
        set_(WidestVectorSet()),
        window_(SideCells(options)),
        layers_(window_.num_cells()),
        hits_(window_.num_cells()),
        changed_(window_.num_cells()),
        planes_(window_.side_cells()),
        candidates_(window_.num_cells()) {
    parts_.emplace_back(window_.num_cells(), RayBinsOf(window_.side_cells(), options.cell_size_m));
    cleared_.reserve(window_.num_cells());
  }

  ScanReport FuseScan(const Scan& scan, std::vector<EvictedCell>& evicted) override {
    ScanReport report;
    Stopwatch stopwatch;
    Move(scan, evicted, report);
    GrowVariances(scan);
    report.seconds.move = stopwatch.Lap();
    Measure(scan.points, report);
    report.seconds.measure = stopwatch.Lap();
    Fuse(report);
    report.seconds.fuse = stopwatch.Lap();
    AnnotateAroundChanged();
    report.seconds.annotate = stopwatch.Lap();
    Clear(report);
    report.seconds.clear = stopwatch.Lap();
    return report;
  }

  void CopyTo(LocalMap& map) const override;

  void EvictAll(std::vector<EvictedCell>& evicted) override {
    for (std::int32_t row = 0; row < window_.side_cells(); ++row) {
      EvictColumns(row, 0, window_.side_cells(), evicted);
    }
  }

 private:
  Place PlaceOf(std::uint32_t index) const {
    const auto side = static_cast<std::uint32_t>(window_.side_cells());
    return {static_cast<std::int16_t>(index % side), static_cast<std::int16_t>(index / side)};
  }
  std::uint32_t IndexOf(Place place) const {
    return static_cast<std::uint32_t>(place.row * window_.side_cells() + place.column);
  }
  std::uint32_t SlotOf(Place place) const { return window_.SlotAt(place.column, place.row); }

  void EvictColumns(std::int32_t row, std::int32_t begin, std::int32_t end,
                    std::vector<EvictedCell>& evicted);
  void Move(const Scan& scan, std::vector<EvictedCell>& evicted, ScanReport& report);
  void GrowVariances(const Scan& scan);
  std::int32_t RangeBinLimit() const;
  void Measure(std::span<const ScanPoint> points, ScanReport& report);
  void LoadGroup(std::size_t first_rank, std::size_t count, LaneCells& cells) const;
  void StoreGroup(std::size_t first_rank, std::size_t count, const LaneCells& cells,
                  ScanReport& report);
  FuseOutcome FuseInto(std::size_t rank);
  void Fuse(ScanReport& report);
  void AnnotateAroundChanged();
  void FindCandidates();
  void Clear(ScanReport& report);

  // Constant after construction.
  const LocalMapOptions options_;
  const FuseLimits limits_;
  const VectorSet set_;

  // The map.
  RingWindow window_;
  Layers layers_;
  bool placed_ = false;
  std::uint64_t seq_ = 0;
  std::int64_t stamp_ns_ = 0;
  Pose<Odom, Base> T_O_B_;

  // Of the scan in hand; members only so that their memory is kept.
  ScanFrame frame_{};
  std::vector<MeasuredPart> parts_;
  HitLanes hits_;
  // By window index, 0 or 1: a point of this scan is in the cell; later, what clearing changed.
  std::vector<std::uint8_t> changed_;
  cpu::PlaneRows planes_;
  cpu::ClearCandidates candidates_;
  std::vector<Place> cleared_;
};

void CpuMapper::EvictColumns(std::int32_t row, std::int32_t begin, std::int32_t end,
                             std::vector<EvictedCell>& evicted) {
  const CellIndex origin = window_.origin();
  for (std::int32_t column = begin; column < end; ++column) {
    const std::uint32_t slot = window_.SlotAt(column, row);
    if (!layers_.known(slot)) continue;
    evicted.push_back({{origin.x + column, origin.y + row}, layers_.BeliefAt(slot)});
    layers_.Forget(slot);
  }
}

void CpuMapper::Move(const Scan& scan, std::vector<EvictedCell>& evicted, ScanReport& report) {
  const std::int32_t side = window_.side_cells();
  const Eigen::Vector3d& base = scan.T_O_B.translation();
  const CellIndex to = WindowOriginAt(base.x(), base.y(), options_.cell_size_m, side);
  if (!placed_) window_.MoveTo(to);
  placed_ = true;
  const std::size_t evicted_before = evicted.size();
  // Columns [keep_begin, keep_end) of the old window stay, in rows that stay.
  const std::int32_t shift_x = to.x - window_.origin().x;
  const std::int32_t shift_y = to.y - window_.origin().y;
  const std::int32_t keep_begin = std::clamp(shift_x, 0, side);
  const std::int32_t keep_end = std::clamp(side + shift_x, 0, side);
  if (shift_x != 0 || shift_y != 0) {
    for (std::int32_t row = 0; row < side; ++row) {
      const bool row_stays = row >= shift_y && row < side + shift_y;
      if (row_stays && keep_begin < keep_end) {
        EvictColumns(row, 0, keep_begin, evicted);
        EvictColumns(row, keep_end, side, evicted);
      } else {
        EvictColumns(row, 0, side, evicted);
      }
    }
    window_.MoveTo(to);
  }
  report.cells_evicted = evicted.size() - evicted_before;
  seq_ = scan.seq;
  frame_ = MakeScanFrame(scan, to, options_);
}

void CpuMapper::GrowVariances(const Scan& scan) {
  const double way_m = (scan.T_O_B.translation() - T_O_B_.translation()).norm();
  const float growth_m2 = GrowthOver(stamp_ns_, scan.stamp_ns, way_m, options_);
  stamp_ns_ = scan.stamp_ns;
  T_O_B_ = scan.T_O_B;
  if (growth_m2 == 0.0f) return;
  RunVectorised(set_, [&] {
    const FuseLimits limits = limits_;
    float* variance_m2 = layers_.variance_m2.data();
    const std::size_t num_cells = layers_.variance_m2.size();
    for (std::size_t i = 0; i < num_cells; ++i) {
      // Zero says unknown here: a known cell has at least the floor, which is above zero.
      const float grown_m2 = GrowVariance(variance_m2[i], growth_m2, limits);
      variance_m2[i] = variance_m2[i] > 0.0f ? grown_m2 : 0.0f;
    }
  });
}

// The range bin beyond which no cell of the window lies, seen from the sensor.
std::int32_t CpuMapper::RangeBinLimit() const {
  const RayBins& bins = parts_.front().rays.bins();
  const float span_m = static_cast<float>(window_.side_cells()) * options_.cell_size_m;
  const float far_x_m =
      std::max(std::fabs(frame_.sensor_x_m), std::fabs(span_m - frame_.sensor_x_m));
  const float far_y_m =
      std::max(std::fabs(frame_.sensor_y_m), std::fabs(span_m - frame_.sensor_y_m));
  const float far_m = std::sqrt(far_x_m * far_x_m + far_y_m * far_y_m);
  // One bin more than the farthest corner asks for, as its distance is rounded here and there.
  return std::min(RangeBinOf(far_m, bins) + 2, bins.range - 1);
}

void CpuMapper::Measure(std::span<const ScanPoint> points, ScanReport& report) {
  const std::int32_t range_bin_limit = RangeBinLimit();
  cpu::MeasurePoints(set_, frame_, points, range_bin_limit, parts_.front());
  report.points = points.size();
  for (const MeasuredPart& part : parts_) {
    const auto count = [&](PointFate fate) { return part.fates[static_cast<std::size_t>(fate)]; };
    report.points_out_of_range += count(PointFate::kOutOfRange);
    report.points_on_body += count(PointFate::kOnBody);
    report.points_out_of_height += count(PointFate::kTooLow) + count(PointFate::kTooHigh);
    report.points_outside_window += count(PointFate::kOutsideWindow);
  }
}

void CpuMapper::LoadGroup(std::size_t first_rank, std::size_t count, LaneCells& cells) const {
  for (std::size_t lane = 0; lane < count; ++lane) {
    const Place place = PlaceOf(hits_.CellOf(first_rank + lane));
    const std::uint32_t slot = SlotOf(place);
    cells.prior_m[lane] = layers_.elevation_m[slot];
    cells.prior_m2[lane] = layers_.variance_m2[slot];
    cells.pose_m2[lane] = PoseVarianceOfCell(frame_, place.column, place.row);
    cells.known[lane] = layers_.known(slot) ? 1 : 0;
    cells.is_free[lane] = layers_.IsFree(slot, options_.traversability_free) ? 1 : 0;
    cells.count[lane] = static_cast<std::int32_t>(hits_.CountOf(first_rank + lane));
  }
  for (std::size_t lane = count; lane < HitLanes::kLanes; ++lane) {
    cells.prior_m[lane] = cells.prior_m2[lane] = cells.pose_m2[lane] = 0;
    cells.known[lane] = cells.is_free[lane] = cells.count[lane] = 0;
  }
}

void CpuMapper::StoreGroup(std::size_t first_rank, std::size_t count, const LaneCells& cells,
                           ScanReport& report) {
  for (std::size_t lane = 0; lane < count; ++lane) {
    const std::uint32_t index = hits_.CellOf(first_rank + lane);
    const std::uint32_t slot = SlotOf(PlaceOf(index));
    layers_.elevation_m[slot] = cells.elevation_m[lane];
    layers_.variance_m2[slot] = cells.variance_m2[lane];
    // The scan has no colours: a cell keeps its own unless it begins anew.
    const bool begun = cells.begun[lane] != 0;
    const unsigned kept = kCellAnnotated | (begun ? 0 : kCellColored);
    layers_.rgba[slot] = begun ? 0 : layers_.rgba[slot];
    layers_.state[slot] = static_cast<std::uint8_t>(kCellKnown | (layers_.state[slot] & kept));
    const bool confirmed = cells.fused[lane] > 0;
    layers_.observed_ns[slot] = confirmed ? stamp_ns_ : layers_.observed_ns[slot];
    changed_[index] = confirmed ? 1 : 0;
    report.points_fused += static_cast<std::uint64_t>(cells.fused[lane]);
    report.points_gated +=
        hits_.CountOf(first_rank + lane) - static_cast<std::uint64_t>(cells.fused[lane]);
    report.cells_restarted += static_cast<std::uint64_t>(cells.restarted[lane]);
    report.cells_inflated += static_cast<std::uint64_t>(cells.inflated[lane]);
  }
}

FuseOutcome CpuMapper::FuseInto(std::size_t rank) {
  const std::uint32_t index = hits_.CellOf(rank);
  const Place place = PlaceOf(index);
  const std::uint32_t slot = SlotOf(place);
  CellFusion cell;
  if (layers_.known(slot)) {
    cell = UnpackCell({layers_.elevation_m[slot], layers_.variance_m2[slot]}, layers_.rgba[slot]);
  }
  const std::span<const Hit> hits = hits_.HitsOf(rank);
  const FuseOutcome outcome =
      FuseCell(cell, hits.data(), static_cast<std::uint32_t>(hits.size()),
               layers_.IsFree(slot, options_.traversability_free),
               PoseVarianceOfCell(frame_, place.column, place.row), limits_);
  layers_.elevation_m[slot] = cell.height.elevation_m;
  layers_.variance_m2[slot] = cell.height.variance_m2;
  layers_.rgba[slot] = PackColor(cell);
  layers_.state[slot] = static_cast<std::uint8_t>(
      kCellKnown | (layers_.state[slot] & kCellAnnotated) | (cell.colored ? kCellColored : 0));
  if (outcome.fused > 0) {
    layers_.observed_ns[slot] = stamp_ns_;
    changed_[index] = 1;
  }
  return outcome;
}

void CpuMapper::Fuse(ScanReport& report) {
  hits_.Sort(parts_);
  std::fill(changed_.begin(), changed_.end(), std::uint8_t{0});
  // Long cells one by one, and all that have colours; the others side by side.
  const std::size_t num_alone = hits_.is_colored() ? hits_.num_cells() : hits_.num_long();
  for (std::size_t rank = 0; rank < num_alone; ++rank) {
    const FuseOutcome outcome = FuseInto(rank);
    report.points_fused += outcome.fused;
    report.points_gated += outcome.gated;
    report.cells_restarted += outcome.restarted ? 1 : 0;
    report.cells_inflated += outcome.inflated ? 1 : 0;
  }
  if (hits_.is_colored()) return;
  LaneCells cells;
  for (std::size_t group = 0; group < hits_.num_groups(); ++group) {
    const std::size_t first = hits_.FirstRankOf(group);
    const std::size_t count = std::min(HitLanes::kLanes, hits_.num_cells() - first);
    LoadGroup(first, count, cells);
    cpu::FuseLanes(set_, hits_.HeightsOf(group), static_cast<std::int32_t>(hits_.CountOf(first)),
                   limits_, cells);
    StoreGroup(first, count, cells, report);
  }
}

void CpuMapper::AnnotateAroundChanged() {
  planes_.Annotate(set_, window_, frame_.sensor_z_m, options_, changed_, 0, window_.side_cells(),
                   layers_);
}

// Known cells that no point of this scan confirmed.
void CpuMapper::FindCandidates() {
  std::size_t count = 0;
  const auto side = static_cast<std::int16_t>(window_.side_cells());
  for (std::int16_t row = 0; row < side; ++row) {
    for (std::int16_t column = 0; column < side; ++column) {
      const Place place{column, row};
      const std::uint32_t slot = SlotOf(place);
      candidates_.place[count] = place;
      candidates_.elevation_m[count] = layers_.elevation_m[slot];
      candidates_.variance_m2[count] = layers_.variance_m2[slot];
      candidates_.is_free[count] = layers_.IsFree(slot, options_.traversability_free) ? 1 : 0;
      count += layers_.known(slot) && changed_[IndexOf(place)] == 0 ? 1 : 0;
    }
  }
  candidates_.count = count;
}

void CpuMapper::Clear(ScanReport& report) {
  FindCandidates();
  cleared_.clear();
  if (candidates_.count > 0) {
    parts_.front().rays.Complete(set_);
    cpu::FindPassedBelow(set_, parts_.front().rays, frame_, options_, candidates_, 0,
                         candidates_.count, cleared_);
  }
  report.cells_cleared = cleared_.size();
  if (!cleared_.empty()) {
    std::fill(changed_.begin(), changed_.end(), std::uint8_t{0});
    for (const Place place : cleared_) {
      layers_.Forget(SlotOf(place));
      changed_[IndexOf(place)] = 1;
      const std::uint32_t rank = hits_.RankOf(IndexOf(place));
      if (rank == 0) continue;
      // The cell was not confirmed, so all its points were counted as gated.
      const FuseOutcome outcome = FuseInto(rank - 1);
      report.points_fused += outcome.fused;
      report.points_gated -= outcome.fused;
    }
    AnnotateAroundChanged();
  }
  hits_.Clear();
}

void CpuMapper::CopyTo(LocalMap& map) const {
  map.stamp_ns = stamp_ns_;
  map.seq = seq_;
  map.T_O_B = T_O_B_;
  map.origin = window_.origin();
  map.side_cells = window_.side_cells();
  map.cell_size_m = options_.cell_size_m;
  map.traversability_free = options_.traversability_free;
  map.ResizeLayers(window_.num_cells());
  const std::int32_t side = window_.side_cells();
  // A row of the window is two runs of its row in the ring: from the seam on, and before it.
  const std::int32_t seam = side - FloorMod(window_.origin().x, side);
  for (std::int32_t row = 0; row < side; ++row) {
    const auto copy_row = [&](const auto& layer, auto& to) {
      const auto run = [&](std::int32_t begin, std::int32_t end) {
        if (begin == end) return;
        std::copy_n(layer.begin() + window_.SlotAt(begin, row), end - begin,
                    to.begin() + row * side + begin);
      };
      run(0, seam);
      run(seam, side);
    };
    copy_row(layers_.state, map.state);
    copy_row(layers_.elevation_m, map.elevation_m);
    copy_row(layers_.variance_m2, map.variance_m2);
    copy_row(layers_.slope_rad, map.slope_rad);
    copy_row(layers_.roughness_m, map.roughness_m);
    copy_row(layers_.traversability, map.traversability);
    copy_row(layers_.rgba, map.rgba);
    copy_row(layers_.observed_ns, map.observed_ns);
  }
}

}  // namespace

std::unique_ptr<LocalMapper> MakeCpuMapper(const LocalMapOptions& options) {
  return std::make_unique<CpuMapper>(options);
}

}  // namespace gem
