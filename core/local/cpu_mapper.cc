#include "core/local/cpu_mapper.h"

#include <algorithm>
#include <cmath>

#include "core/base/stopwatch.h"
#include "core/local/annotate.h"
#include "core/local/clear.h"
#include "core/local/fuse.h"
#include "core/local/measure.h"
#include "core/local/ray_table.h"
#include "core/local/ring_window.h"

namespace gem {
namespace {

// Layers by slot of the ring. A value without its state bit is zero.
struct Layers {
  explicit Layers(std::size_t num_cells)
      : state(num_cells),
        elevation_m(num_cells),
        variance_m2(num_cells),
        slope_rad(num_cells),
        roughness_m(num_cells),
        traversability(num_cells),
        rgba(num_cells),
        observed_ns(num_cells) {}

  bool known(std::uint32_t slot) const { return (state[slot] & kCellKnown) != 0; }

  CellBelief BeliefAt(std::uint32_t slot) const {
    return {elevation_m[slot], variance_m2[slot], traversability[slot],
            rgba[slot],        observed_ns[slot], state[slot]};
  }
  void Annotate(std::uint32_t slot, const Annotation& annotation) {
    state[slot] = static_cast<std::uint8_t>((state[slot] & ~kCellAnnotated) |
                                            (annotation.valid ? kCellAnnotated : 0));
    slope_rad[slot] = annotation.slope_rad;
    roughness_m[slot] = annotation.roughness_m;
    traversability[slot] = annotation.traversability;
  }
  void Forget(std::uint32_t slot) {
    elevation_m[slot] = variance_m2[slot] = 0;
    rgba[slot] = 0;
    observed_ns[slot] = 0;
    Annotate(slot, Annotation());
    state[slot] = 0;
  }

  std::vector<std::uint8_t> state;
  std::vector<float> elevation_m;
  std::vector<float> variance_m2;
  std::vector<float> slope_rad;
  std::vector<float> roughness_m;
  std::vector<float> traversability;
  std::vector<Rgba> rgba;
  std::vector<std::int64_t> observed_ns;
};

// The points of one scan over one cell, and what became of them.
struct CellHits {
  std::uint32_t begin = 0;  // in sorted_hits_
  std::uint32_t count = 0;
  bool confirmed = false;  // a point of this scan is in the cell
};

class CpuMapper final : public LocalMapper {
 public:
  explicit CpuMapper(const LocalMapOptions& options)
      : options_(options),
        limits_(FuseLimitsOf(options)),
        window_(SideCells(options)),
        layers_(window_.num_cells()),
        cell_hits_(window_.num_cells()),
        marked_(window_.num_cells()),
        rays_(RayBinsOf(window_.side_cells(), options.cell_size_m)) {
    // Lists of cells are bounded by the window: grown here, they never grow again.
    touched_.reserve(window_.num_cells());
    changed_.reserve(window_.num_cells());
    dirty_.reserve(window_.num_cells());
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
    SortHits();
    Fuse(report);
    report.seconds.fuse = stopwatch.Lap();
    AnnotateAroundChanged();
    report.seconds.annotate = stopwatch.Lap();
    Clear(report);
    AnnotateAroundChanged();
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
  // A cell of the window from the lower left; fits, as a side has at most 1024 cells.
  struct Place {
    std::int16_t column = 0;
    std::int16_t row = 0;
  };

  bool IsFree(std::uint32_t slot) const {
    // Zero where it is not annotated, and the limit is above zero: unknown is never free.
    return layers_.traversability[slot] > options_.traversability_free;
  }
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
  void Measure(std::span<const ScanPoint> points, ScanReport& report);
  void SortHits();
  FuseOutcome FuseInto(Place place);
  void Fuse(ScanReport& report);
  void AnnotateAroundChanged();
  Annotation AnnotationOf(Place place) const;
  void FillRays();
  CellSight SightOfCell(Place place) const;
  void FindCleared();
  void Clear(ScanReport& report);

  // Constant after construction.
  const LocalMapOptions options_;
  const FuseLimits limits_;

  // The map.
  RingWindow window_;
  Layers layers_;
  bool placed_ = false;
  std::uint64_t seq_ = 0;
  std::int64_t stamp_ns_ = 0;
  Pose<Odom, Base> T_O_B_;

  // Of the scan in hand; members only so that their memory is kept. Indexed by window place.
  ScanFrame frame_{};
  std::vector<Hit> hits_;                // in point order
  std::vector<std::uint32_t> hit_cell_;  // window index of each of hits_
  std::vector<Hit> sorted_hits_;         // by cell, within a cell in point order
  std::vector<CellHits> cell_hits_;      // all zero between scans
  std::vector<Place> touched_;           // cells with hits, by their first point
  std::vector<Place> changed_;           // cells whose elevation is new since the last annotation
  std::vector<std::uint8_t> marked_;     // all zero but while dirty_ is gathered
  std::vector<Place> dirty_;             // cells to be annotated
  std::vector<Place> cleared_;
  std::vector<float> ray_x_m_, ray_y_m_, ray_z_m_;  // ends of the rays that count, from the sensor
  std::size_t num_rays_ = 0;
  RayTable rays_;
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
  for (float& variance_m2 : layers_.variance_m2) {
    // Zero says unknown here: a known cell has at least the floor, which is above zero.
    const float grown_m2 = GrowVariance(variance_m2, growth_m2, limits_);
    variance_m2 = variance_m2 > 0.0f ? grown_m2 : 0.0f;
  }
}

void CpuMapper::Measure(std::span<const ScanPoint> points, ScanReport& report) {
  hits_.clear();
  hit_cell_.clear();
  ray_x_m_.resize(points.size());
  ray_y_m_.resize(points.size());
  ray_z_m_.resize(points.size());
  num_rays_ = 0;
  std::uint64_t fates[6] = {};
  for (const ScanPoint& p_S : points) {
    const Beam beam = MeasureBeam(frame_, p_S);
    ++fates[static_cast<std::size_t>(beam.fate)];
    ray_x_m_[num_rays_] = beam.x_m;
    ray_y_m_[num_rays_] = beam.y_m;
    ray_z_m_[num_rays_] = beam.z_m;
    num_rays_ += RayCounts(beam.fate) ? 1 : 0;  // else the next point takes its place
    if (beam.fate != PointFate::kInWindow) continue;
    hits_.push_back({{ElevationOf(frame_, beam), SensorVarianceOf(frame_, p_S, beam)}, p_S.rgba});
    hit_cell_.push_back(static_cast<std::uint32_t>(beam.row * window_.side_cells() + beam.column));
  }
  report.points = points.size();
  report.points_out_of_range = fates[static_cast<std::size_t>(PointFate::kOutOfRange)];
  report.points_on_body = fates[static_cast<std::size_t>(PointFate::kOnBody)];
  report.points_out_of_height = fates[static_cast<std::size_t>(PointFate::kTooLow)] +
                                fates[static_cast<std::size_t>(PointFate::kTooHigh)];
  report.points_outside_window = fates[static_cast<std::size_t>(PointFate::kOutsideWindow)];
}

// Stable counting sort by cell: points of a cell stay in the scan's order.
void CpuMapper::SortHits() {
  touched_.clear();
  for (const std::uint32_t index : hit_cell_) {
    if (cell_hits_[index].count++ == 0) touched_.push_back(PlaceOf(index));
  }
  std::uint32_t begin = 0;
  for (const Place place : touched_) {
    CellHits& hits = cell_hits_[IndexOf(place)];
    hits.begin = begin;
    begin += hits.count;
    hits.count = 0;  // counted again while the hits are dealt out
  }
  sorted_hits_.resize(hits_.size());
  for (std::size_t i = 0; i < hits_.size(); ++i) {
    CellHits& hits = cell_hits_[hit_cell_[i]];
    sorted_hits_[hits.begin + hits.count++] = hits_[i];
  }
}

FuseOutcome CpuMapper::FuseInto(Place place) {
  CellHits& hits = cell_hits_[IndexOf(place)];
  const std::uint32_t slot = SlotOf(place);
  CellFusion cell;
  if (layers_.known(slot)) {
    cell = UnpackCell({layers_.elevation_m[slot], layers_.variance_m2[slot]}, layers_.rgba[slot]);
  }
  const FuseOutcome outcome =
      FuseCell(cell, &sorted_hits_[hits.begin], hits.count, IsFree(slot),
               PoseVarianceOfCell(frame_, place.column, place.row), limits_);
  layers_.elevation_m[slot] = cell.height.elevation_m;
  layers_.variance_m2[slot] = cell.height.variance_m2;
  layers_.rgba[slot] = PackColor(cell);
  layers_.state[slot] = static_cast<std::uint8_t>(
      kCellKnown | (layers_.state[slot] & kCellAnnotated) | (cell.colored ? kCellColored : 0));
  if (outcome.fused > 0) {
    layers_.observed_ns[slot] = stamp_ns_;
    hits.confirmed = true;
    changed_.push_back(place);
  }
  return outcome;
}

void CpuMapper::Fuse(ScanReport& report) {
  changed_.clear();
  for (const Place place : touched_) {
    const FuseOutcome outcome = FuseInto(place);
    report.points_fused += outcome.fused;
    report.points_gated += outcome.gated;
    report.cells_restarted += outcome.restarted ? 1 : 0;
    report.cells_inflated += outcome.inflated ? 1 : 0;
  }
}

Annotation CpuMapper::AnnotationOf(Place place) const {
  const std::int32_t side = window_.side_cells();
  const double sensor_z_m = frame_.sensor_z_m;
  PlaneSums sums;
  // Neighbours by window coordinates: across the seam of the ring they are neighbours all the same.
  for (std::int32_t dx = -kPlaneRadius_cells; dx <= kPlaneRadius_cells; ++dx) {
    const std::int32_t column = place.column + dx;
    ColumnSums column_sums;
    for (std::int32_t dy = -kPlaneRadius_cells; dy <= kPlaneRadius_cells; ++dy) {
      const std::int32_t row = place.row + dy;
      if (column < 0 || column >= side || row < 0 || row >= side) continue;
      const std::uint32_t slot = window_.SlotAt(column, row);
      column_sums.Add(dy, layers_.known(slot), layers_.elevation_m[slot] - sensor_z_m);
    }
    sums.Add(dx, column_sums);
  }
  return AnnotatePlane(FitPlane(sums, options_.plane_cells_min), options_);
}

void CpuMapper::AnnotateAroundChanged() {
  const std::int32_t side = window_.side_cells();
  dirty_.clear();
  for (const Place place : changed_) {
    const std::int32_t row_end = std::min(place.row + kPlaneRadius_cells + 1, side);
    const std::int32_t column_end = std::min(place.column + kPlaneRadius_cells + 1, side);
    for (std::int32_t row = std::max(place.row - kPlaneRadius_cells, 0); row < row_end; ++row) {
      for (std::int32_t column = std::max(place.column - kPlaneRadius_cells, 0);
           column < column_end; ++column) {
        const Place near{static_cast<std::int16_t>(column), static_cast<std::int16_t>(row)};
        std::uint8_t& mark = marked_[IndexOf(near)];
        if (mark == 0) dirty_.push_back(near);
        mark = 1;
      }
    }
  }
  for (const Place place : dirty_) {
    marked_[IndexOf(place)] = 0;
    const std::uint32_t slot = SlotOf(place);
    if (layers_.known(slot)) layers_.Annotate(slot, AnnotationOf(place));
  }
  changed_.clear();
}

CellSight CpuMapper::SightOfCell(Place place) const {
  return SightOf(static_cast<float>(place.column) * options_.cell_size_m - frame_.sensor_x_m,
                 static_cast<float>(place.row) * options_.cell_size_m - frame_.sensor_y_m,
                 rays_.bins());
}

void CpuMapper::FillRays() {
  const RayBins& bins = rays_.bins();
  const float span_m = static_cast<float>(window_.side_cells()) * options_.cell_size_m;
  const float far_x_m =
      std::max(std::fabs(frame_.sensor_x_m), std::fabs(span_m - frame_.sensor_x_m));
  const float far_y_m =
      std::max(std::fabs(frame_.sensor_y_m), std::fabs(span_m - frame_.sensor_y_m));
  const float far_m = std::sqrt(far_x_m * far_x_m + far_y_m * far_y_m);
  // One bin more than the farthest corner asks for, as its distance is rounded here and there.
  rays_.Reset(std::min(RangeBinOf(far_m, bins) + 2, bins.range - 1));
  rays_.Add(ray_x_m_.data(), ray_y_m_.data(), ray_z_m_.data(), num_rays_);
  rays_.Complete();
}

void CpuMapper::FindCleared() {
  // Candidates first: without any, which is common, the rays need not be looked at.
  for (std::int32_t row = 0; row < window_.side_cells(); ++row) {
    for (std::int32_t column = 0; column < window_.side_cells(); ++column) {
      const Place place{static_cast<std::int16_t>(column), static_cast<std::int16_t>(row)};
      const std::uint32_t slot = SlotOf(place);
      if (!layers_.known(slot) || cell_hits_[IndexOf(place)].confirmed) continue;
      cleared_.push_back(place);
    }
  }
  if (cleared_.empty()) return;
  FillRays();
  std::erase_if(cleared_, [this](Place place) {
    const std::uint32_t slot = SlotOf(place);
    const float height_m =
        ClearHeightOf(layers_.elevation_m[slot], layers_.variance_m2[slot], IsFree(slot), options_);
    return !rays_.AllPassBelow(SightOfCell(place), frame_.sensor_z_m, height_m);
  });
}

void CpuMapper::Clear(ScanReport& report) {
  cleared_.clear();
  FindCleared();
  report.cells_cleared = cleared_.size();
  for (const Place place : cleared_) {
    layers_.Forget(SlotOf(place));
    if (cell_hits_[IndexOf(place)].count == 0) {
      changed_.push_back(place);
      continue;
    }
    // The cell was not confirmed, so all its points were counted as gated.
    const FuseOutcome outcome = FuseInto(place);
    report.points_fused += outcome.fused;
    report.points_gated -= outcome.fused;
  }
  for (const Place place : touched_) cell_hits_[IndexOf(place)] = CellHits();
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
