#include "core/local/reference_mapper.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>

#include "core/base/stopwatch.h"
#include "core/local/annotate.h"
#include "core/local/clear.h"
#include "core/local/fuse.h"
#include "core/local/measure.h"
#include "core/local/ring_window.h"

namespace gem {
namespace {

struct Cell {
  CellBelief belief;
  float slope_rad = 0;
  float roughness_m = 0;
};

class ReferenceMapper final : public LocalMapper {
 public:
  explicit ReferenceMapper(const LocalMapOptions& options)
      : options_(options),
        side_cells_(SideCells(options)),
        limits_(FuseLimitsOf(options)),
        bins_(RayBinsOf(side_cells_, options.cell_size_m)),
        cells_(static_cast<std::size_t>(side_cells_) * static_cast<std::size_t>(side_cells_)) {}

  ScanReport FuseScan(const Scan& scan, std::vector<EvictedCell>& evicted) override {
    ScanReport report;
    Stopwatch stopwatch;
    Move(scan, evicted, report);
    GrowVariances(scan);
    report.seconds.move = stopwatch.Lap();
    Measure(scan, report);
    report.seconds.measure = stopwatch.Lap();
    Fuse(report);
    report.seconds.fuse = stopwatch.Lap();
    AnnotateChanged();
    report.seconds.annotate = stopwatch.Lap();
    Clear(report);
    AnnotateChanged();
    report.seconds.clear = stopwatch.Lap();
    return report;
  }

  void CopyTo(LocalMap& map) const override;

  void EvictAll(std::vector<EvictedCell>& evicted) override {
    EvictOutside({{0, 0}, {0, 0}}, evicted);
  }

 private:
  bool InWindow(std::int32_t column, std::int32_t row) const {
    return column >= 0 && column < side_cells_ && row >= 0 && row < side_cells_;
  }
  std::size_t IndexAt(std::int32_t column, std::int32_t row) const {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(side_cells_) +
           static_cast<std::size_t>(column);
  }
  bool IsFree(const Cell& cell) const {
    return cell.belief.annotated() && cell.belief.traversability > options_.traversability_free;
  }

  std::uint64_t EvictOutside(CellRect kept, std::vector<EvictedCell>& evicted);
  void Move(const Scan& scan, std::vector<EvictedCell>& evicted, ScanReport& report);
  void GrowVariances(const Scan& scan);
  void Measure(const Scan& scan, ScanReport& report);
  void Fuse(ScanReport& report);
  FuseOutcome FuseInto(std::size_t index);
  void AnnotateChanged();
  void AnnotateCell(std::int32_t column, std::int32_t row);
  bool IsPassedBelow(const Cell& cell, std::int32_t column, std::int32_t row) const;
  void Clear(ScanReport& report);

  // Constant after construction.
  const LocalMapOptions options_;
  const std::int32_t side_cells_;
  const FuseLimits limits_;
  const RayBins bins_;

  bool placed_ = false;
  CellIndex origin_;
  std::uint64_t seq_ = 0;
  std::int64_t stamp_ns_ = 0;
  Pose<Odom, Base> T_O_B_;
  std::vector<Cell> cells_;  // rows from the lower left

  // Of the scan in hand.
  ScanFrame frame_{};
  std::vector<std::vector<Hit>> hits_;  // by cell
  std::vector<Ray> rays_;
  std::vector<bool> confirmed_;  // by cell: a point of this scan is in it
  std::vector<bool> changed_;    // by cell: since the last annotation
};

std::uint64_t ReferenceMapper::EvictOutside(CellRect kept, std::vector<EvictedCell>& evicted) {
  std::uint64_t count = 0;
  for (std::int32_t row = 0; row < side_cells_; ++row) {
    for (std::int32_t column = 0; column < side_cells_; ++column) {
      const CellIndex index{origin_.x + column, origin_.y + row};
      Cell& cell = cells_[IndexAt(column, row)];
      if (kept.Contains(index)) continue;
      if (cell.belief.known()) {
        evicted.push_back({index, cell.belief});
        ++count;
      }
      cell = Cell();
    }
  }
  return count;
}

void ReferenceMapper::Move(const Scan& scan, std::vector<EvictedCell>& evicted,
                           ScanReport& report) {
  const Eigen::Vector3d& base = scan.T_O_B.translation();
  const CellIndex origin = WindowOriginAt(base.x(), base.y(), options_.cell_size_m, side_cells_);
  if (!placed_) origin_ = origin;
  placed_ = true;
  const CellRect window{origin, {origin.x + side_cells_, origin.y + side_cells_}};
  report.cells_evicted = EvictOutside(window, evicted);
  std::vector<Cell> moved(cells_.size());
  for (std::int32_t row = 0; row < side_cells_; ++row) {
    for (std::int32_t column = 0; column < side_cells_; ++column) {
      const std::int32_t old_column = column + origin.x - origin_.x;
      const std::int32_t old_row = row + origin.y - origin_.y;
      if (InWindow(old_column, old_row)) {
        moved[IndexAt(column, row)] = cells_[IndexAt(old_column, old_row)];
      }
    }
  }
  cells_ = moved;
  origin_ = origin;
  seq_ = scan.seq;
  frame_ = MakeScanFrame(scan, origin_, options_);
}

void ReferenceMapper::GrowVariances(const Scan& scan) {
  const double way_m = (scan.T_O_B.translation() - T_O_B_.translation()).norm();
  const float growth_m2 = GrowthOver(stamp_ns_, scan.stamp_ns, way_m, options_);
  stamp_ns_ = scan.stamp_ns;
  T_O_B_ = scan.T_O_B;
  for (Cell& cell : cells_) {
    if (!cell.belief.known()) continue;
    cell.belief.variance_m2 = GrowVariance(cell.belief.variance_m2, growth_m2, limits_);
  }
}

void ReferenceMapper::Measure(const Scan& scan, ScanReport& report) {
  hits_.assign(cells_.size(), {});
  rays_.clear();
  report.points = scan.num_points();
  for (std::size_t i = 0; i < scan.num_points(); ++i) {
    const ScanPoint p_S = scan.PointAt(i);
    const Beam beam = MeasureBeam(frame_, p_S);
    if (RayCounts(beam.fate)) rays_.push_back(RayTo(beam.x_m, beam.y_m, beam.z_m, bins_));
    switch (beam.fate) {
      case PointFate::kOutOfRange:
        ++report.points_out_of_range;
        break;
      case PointFate::kOnBody:
        ++report.points_on_body;
        break;
      case PointFate::kTooLow:
      case PointFate::kTooHigh:
        ++report.points_out_of_height;
        break;
      case PointFate::kOutsideWindow:
        ++report.points_outside_window;
        break;
      case PointFate::kInWindow:
        hits_[IndexAt(beam.column, beam.row)].push_back(
            {{ElevationOf(frame_, beam), SensorVarianceOf(frame_, p_S, beam)}, p_S.rgba});
        break;
    }
  }
}

FuseOutcome ReferenceMapper::FuseInto(std::size_t index) {
  Cell& cell = cells_[index];
  CellBelief& belief = cell.belief;
  const std::vector<Hit>& hits = hits_[index];
  const auto column = static_cast<std::int32_t>(index % static_cast<std::size_t>(side_cells_));
  const auto row = static_cast<std::int32_t>(index / static_cast<std::size_t>(side_cells_));
  CellFusion fusion;
  if (belief.known()) fusion = UnpackCell({belief.elevation_m, belief.variance_m2}, belief.rgba);
  const FuseOutcome outcome =
      FuseCell(fusion, hits.data(), static_cast<std::uint32_t>(hits.size()), IsFree(cell),
               PoseVarianceOfCell(frame_, column, row), limits_);
  belief.elevation_m = fusion.height.elevation_m;
  belief.variance_m2 = fusion.height.variance_m2;
  belief.rgba = PackColor(fusion);
  belief.state = static_cast<std::uint8_t>(kCellKnown | (belief.state & kCellAnnotated) |
                                           (fusion.colored ? kCellColored : 0));
  if (outcome.fused > 0) {
    belief.stamp_ns = stamp_ns_;
    confirmed_[index] = true;
    changed_[index] = true;
  }
  return outcome;
}

void ReferenceMapper::Fuse(ScanReport& report) {
  confirmed_.assign(cells_.size(), false);
  changed_.assign(cells_.size(), false);
  for (std::size_t index = 0; index < cells_.size(); ++index) {
    if (hits_[index].empty()) continue;
    const FuseOutcome outcome = FuseInto(index);
    report.points_fused += outcome.fused;
    report.points_gated += outcome.gated;
    report.cells_restarted += outcome.restarted ? 1 : 0;
    report.cells_inflated += outcome.inflated ? 1 : 0;
  }
}

void ReferenceMapper::AnnotateCell(std::int32_t column, std::int32_t row) {
  Cell& cell = cells_[IndexAt(column, row)];
  std::vector<Eigen::Vector3d> points;
  for (std::int32_t dy = -kPlaneRadius_cells; dy <= kPlaneRadius_cells; ++dy) {
    for (std::int32_t dx = -kPlaneRadius_cells; dx <= kPlaneRadius_cells; ++dx) {
      if (!InWindow(column + dx, row + dy)) continue;
      const CellBelief& other = cells_[IndexAt(column + dx, row + dy)].belief;
      if (!other.known()) continue;
      const double height_m = static_cast<double>(other.elevation_m) - cell.belief.elevation_m;
      points.emplace_back(dx * static_cast<double>(options_.cell_size_m),
                          dy * static_cast<double>(options_.cell_size_m), height_m);
    }
  }
  cell.slope_rad = cell.roughness_m = cell.belief.traversability = 0;
  cell.belief.state &= static_cast<std::uint8_t>(~kCellAnnotated);
  if (static_cast<std::int32_t>(points.size()) < options_.plane_cells_min) return;

  const auto count = static_cast<Eigen::Index>(points.size());
  Eigen::MatrixXd places(count, 3);
  Eigen::VectorXd heights(count);
  for (Eigen::Index i = 0; i < count; ++i) {
    const Eigen::Vector3d& point = points[static_cast<std::size_t>(i)];
    places.row(i) << point.x(), point.y(), 1.0;
    heights(i) = point.z();
  }
  const Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(places);
  if (qr.rank() < 3) return;  // all on one line
  const Eigen::Vector3d plane = qr.solve(heights);
  const double squares_m2 = (heights - places * plane).squaredNorm();
  cell.slope_rad = static_cast<float>(std::atan(plane.head<2>().norm()));
  cell.roughness_m =
      count > 3 ? static_cast<float>(std::sqrt(squares_m2 / static_cast<double>(count - 3))) : 0.0f;
  cell.belief.traversability = TraversabilityOf(cell.slope_rad, cell.roughness_m, options_);
  cell.belief.state |= kCellAnnotated;
}

void ReferenceMapper::AnnotateChanged() {
  for (std::int32_t row = 0; row < side_cells_; ++row) {
    for (std::int32_t column = 0; column < side_cells_; ++column) {
      if (!cells_[IndexAt(column, row)].belief.known()) continue;
      bool near_change = false;
      for (std::int32_t dy = -kPlaneRadius_cells; dy <= kPlaneRadius_cells; ++dy) {
        for (std::int32_t dx = -kPlaneRadius_cells; dx <= kPlaneRadius_cells; ++dx) {
          near_change = near_change || (InWindow(column + dx, row + dy) &&
                                        changed_[IndexAt(column + dx, row + dy)]);
        }
      }
      if (near_change) AnnotateCell(column, row);
    }
  }
  changed_.assign(cells_.size(), false);
}

bool ReferenceMapper::IsPassedBelow(const Cell& cell, std::int32_t column, std::int32_t row) const {
  const CellSight sight =
      SightOf(static_cast<float>(column) * options_.cell_size_m - frame_.sensor_x_m,
              static_cast<float>(row) * options_.cell_size_m - frame_.sensor_y_m, bins_);
  const float height_m =
      ClearHeightOf(cell.belief.elevation_m, cell.belief.variance_m2, IsFree(cell), options_);
  std::vector<bool> has_rays(static_cast<std::size_t>(sight.num_bins), false);
  std::vector<bool> passed(has_rays);
  for (const Ray& ray : rays_) {
    const auto bin =
        static_cast<std::size_t>(FloorMod(ray.azimuth_bin - sight.first_bin, bins_.azimuth));
    if (bin >= passed.size() || ray.range_bin == 0) continue;
    has_rays[bin] = true;
    if (ray.range_bin < sight.range_bin_min) continue;
    if (RayTopOver(sight, ray.slope, frame_.sensor_z_m) < height_m) passed[bin] = true;
  }
  // Each direction that the sensor looked in must have a ray that passes below the cell.
  return has_rays == passed && std::find(passed.begin(), passed.end(), true) != passed.end();
}

void ReferenceMapper::Clear(ScanReport& report) {
  std::vector<std::size_t> cleared;
  for (std::int32_t row = 0; row < side_cells_; ++row) {
    for (std::int32_t column = 0; column < side_cells_; ++column) {
      const std::size_t index = IndexAt(column, row);
      const Cell& cell = cells_[index];
      if (!cell.belief.known() || confirmed_[index]) continue;
      if (IsPassedBelow(cell, column, row)) cleared.push_back(index);
    }
  }
  report.cells_cleared = cleared.size();
  for (const std::size_t index : cleared) {
    cells_[index] = Cell();
    changed_[index] = true;
    if (hits_[index].empty()) continue;
    // The cell was not confirmed, so all its points were counted as gated.
    const FuseOutcome outcome = FuseInto(index);
    report.points_fused += outcome.fused;
    report.points_gated -= outcome.fused;
  }
}

void ReferenceMapper::CopyTo(LocalMap& map) const {
  map.stamp_ns = stamp_ns_;
  map.seq = seq_;
  map.T_O_B = T_O_B_;
  map.origin = origin_;
  map.side_cells = side_cells_;
  map.cell_size_m = options_.cell_size_m;
  map.traversability_free = options_.traversability_free;
  map.ResizeLayers(cells_.size());
  for (std::size_t index = 0; index < cells_.size(); ++index) {
    const CellBelief& belief = cells_[index].belief;
    map.state[index] = belief.state;
    map.elevation_m[index] = belief.elevation_m;
    map.variance_m2[index] = belief.variance_m2;
    map.slope_rad[index] = cells_[index].slope_rad;
    map.roughness_m[index] = cells_[index].roughness_m;
    map.traversability[index] = belief.traversability;
    map.rgba[index] = belief.rgba;
    map.observed_ns[index] = belief.stamp_ns;
  }
}

}  // namespace

std::unique_ptr<LocalMapper> MakeReferenceMapper(const LocalMapOptions& options) {
  return std::make_unique<ReferenceMapper>(options);
}

}  // namespace gem
