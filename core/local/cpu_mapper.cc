#include "core/local/cpu_mapper.h"

#include <algorithm>
#include <cmath>

#include "core/base/stopwatch.h"
#include "core/base/thread_team.h"
#include "core/base/vector_set.h"
#include "core/local/clear.h"
#include "core/local/cpu/fuse_cells.h"
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

using cpu::FuseTarget;
using cpu::HitLanes;
using cpu::Layers;
using cpu::MeasuredPart;

// What one thread of the team works with. A cache line of its own, as all write theirs at once.
struct alignas(64) Desk {
  explicit Desk(const RingWindow& window)
      : sorted(window.num_cells()), planes(window.side_cells()), candidates(window.num_cells()) {
    cleared.reserve(window.num_cells());
  }

  // A band of rows is this desk's: the same thread annotates and clears there, so that its cells
  // stay in its cache. Where it sorts and fuses, about as many hits lie as elsewhere.
  Piece rows{0, 0};
  Piece fuse_rows{0, 0};
  HitLanes sorted;
  std::vector<Hit> hits;  // of one cell
  cpu::PlaneRows planes;
  cpu::ClearCandidates candidates;
  std::vector<Place> cleared;
  ScanReport report;  // of its share of the cells
};

class CpuMapper final : public LocalMapper {
 public:
  CpuMapper(const LocalMapOptions& options, int threads, VectorSet set)
      : options_(options),
        limits_(FuseLimitsOf(options)),
        set_(set),
        team_(threads),
        window_(SideCells(options)),
        layers_(window_.num_cells()),
        rays_(RayBinsOf(window_.side_cells(), options.cell_size_m)),
        runs_(static_cast<std::size_t>(threads)),
        next_fuse_rows_(static_cast<std::size_t>(threads)),
        changed_(window_.num_cells()) {
    for (int i = 0; i < threads; ++i) {
      sectors_.push_back(SectorOf(i));
      parts_.emplace_back(window_.num_cells(), sectors_.back());
      desks_.emplace_back(window_);
      desks_.back().rows = PieceOf(static_cast<std::size_t>(window_.side_cells()), i, threads);
      desks_.back().fuse_rows = desks_.back().rows;
    }
  }

  void Expect() override { team_.Wake(); }

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
  // Of two threads, the one that has the lower rows of the window has the rays that go there.
  AzimuthSector SectorOf(int thread) const {
    const Piece bins = PieceOf(static_cast<std::size_t>(rays_.bins().azimuth),
                               team_.size() - 1 - thread, team_.size());
    return {static_cast<std::int32_t>(bins.begin), static_cast<std::int32_t>(bins.end)};
  }
  void EvictColumns(std::int32_t row, std::int32_t begin, std::int32_t end,
                    std::vector<EvictedCell>& evicted);
  void Move(const Scan& scan, std::vector<EvictedCell>& evicted, ScanReport& report);
  void GrowVariances(const Scan& scan);
  std::int32_t RangeBinLimit() const;
  void Measure(const Scan& scan, ScanReport& report);
  FuseTarget Target() {
    return {set_,      window_, frame_,  limits_, options_.traversability_free,
            stamp_ns_, layers_, changed_};
  }
  void Fuse(ScanReport& report);
  void BalanceFuseRows();
  void AnnotateAroundChanged();
  void FindCleared();
  void ClearCell(Place place, ScanReport& report);
  void Clear(ScanReport& report);

  // Constant after construction.
  const LocalMapOptions options_;
  const FuseLimits limits_;
  const VectorSet set_;

  ThreadTeam team_;

  // The map.
  RingWindow window_;
  Layers layers_;
  bool placed_ = false;
  std::uint64_t seq_ = 0;
  std::int64_t stamp_ns_ = 0;
  Pose<Odom, Base> T_O_B_;

  // Of the scan in hand; members only so that their memory is kept.
  ScanFrame frame_{};
  std::vector<AzimuthSector> sectors_;  // by thread
  RayTable rays_;
  cpu::PointRuns runs_;
  std::vector<MeasuredPart> parts_;  // one of each thread
  std::vector<Desk> desks_;          // one of each thread
  std::vector<Piece> next_fuse_rows_;
  std::vector<cpu::HitRun> hit_runs_;
  // By window index, 0 or 1: a point of this scan is in the cell; later, what clearing changed.
  std::vector<std::uint8_t> changed_;
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
  const RayBins& bins = rays_.bins();
  const float span_m = static_cast<float>(window_.side_cells()) * options_.cell_size_m;
  const float far_x_m =
      std::max(std::fabs(frame_.sensor_x_m), std::fabs(span_m - frame_.sensor_x_m));
  const float far_y_m =
      std::max(std::fabs(frame_.sensor_y_m), std::fabs(span_m - frame_.sensor_y_m));
  const float far_m = std::sqrt(far_x_m * far_x_m + far_y_m * far_y_m);
  // One bin more than the farthest corner asks for, as its distance is rounded here and there.
  return std::min(RangeBinOf(far_m, bins) + 2, bins.range - 1);
}

void CpuMapper::Measure(const Scan& scan, ScanReport& report) {
  rays_.SetLimit(RangeBinLimit());
  runs_.Plan(set_, frame_, scan, rays_.bins(), sectors_);
  hit_runs_.resize(runs_.runs().size());
  const cpu::PointPass pass{set_, frame_, scan, runs_, hit_runs_, rays_};
  // What is made of the runs does not depend on who measured them.
  team_.Run([&](int i) {
    const auto thread = static_cast<std::size_t>(i);
    cpu::MeasureRuns(pass, thread, parts_[thread]);
  });
  report.points = scan.num_points();
  for (const MeasuredPart& part : parts_) {
    const auto count = [&](PointFate fate) { return part.fates[static_cast<std::size_t>(fate)]; };
    report.points_out_of_range += count(PointFate::kOutOfRange);
    report.points_on_body += count(PointFate::kOnBody);
    report.points_out_of_height += count(PointFate::kTooLow) + count(PointFate::kTooHigh);
    report.points_outside_window += count(PointFate::kOutsideWindow);
  }
}

void CpuMapper::Fuse(ScanReport& report) {
  const FuseTarget target = Target();
  const auto side = static_cast<std::size_t>(window_.side_cells());
  team_.Run([&](int i) {
    Desk& desk = desks_[static_cast<std::size_t>(i)];
    const Piece cells{desk.fuse_rows.begin * side, desk.fuse_rows.end * side};
    std::fill(changed_.data() + cells.begin, changed_.data() + cells.end, std::uint8_t{0});
    desk.sorted.Sort(parts_, hit_runs_, static_cast<std::uint32_t>(cells.begin),
                     static_cast<std::uint32_t>(cells.end));
    desk.report = ScanReport();
    cpu::FuseCells(target, desk.sorted, desk.hits, desk.report);
  });
  for (const Desk& desk : desks_) {
    report.points_fused += desk.report.points_fused;
    report.points_gated += desk.report.points_gated;
    report.cells_restarted += desk.report.cells_restarted;
    report.cells_inflated += desk.report.cells_inflated;
  }
  BalanceFuseRows();
}

// The next scan's hits lie about as this one's.
void CpuMapper::BalanceFuseRows() {
  const auto side = static_cast<double>(window_.side_cells());
  const auto work_of = [&](const Desk& desk) {
    const double hits = static_cast<double>(desk.report.points_fused + desk.report.points_gated);
    return hits + side * static_cast<double>(desk.fuse_rows.end - desk.fuse_rows.begin);
  };
  double work = 0;
  for (const Desk& desk : desks_) work += work_of(desk);
  const double share = work / static_cast<double>(desks_.size());
  // Walks up the old bands, in which work is taken to be spread evenly, and ends a new one after
  // each share.
  double done = 0;
  std::size_t next = 0, begin = 0;
  for (const Desk& desk : desks_) {
    const Piece rows = desk.fuse_rows;
    const double here = work_of(desk);
    for (; next + 1 < desks_.size() && done + here >= share * static_cast<double>(next + 1);
         ++next) {
      const double part = (share * static_cast<double>(next + 1) - done) / std::max(here, 1.0);
      const double end =
          static_cast<double>(rows.begin) + part * static_cast<double>(rows.end - rows.begin);
      next_fuse_rows_[next] = {begin, static_cast<std::size_t>(end)};
      begin = next_fuse_rows_[next].end;
    }
    done += here;
  }
  next_fuse_rows_.back() = {begin, static_cast<std::size_t>(window_.side_cells())};
  for (std::size_t i = 0; i < desks_.size(); ++i) desks_[i].fuse_rows = next_fuse_rows_[i];
}

void CpuMapper::AnnotateAroundChanged() {
  team_.Run([&](int i) {
    Desk& desk = desks_[static_cast<std::size_t>(i)];
    desk.planes.Annotate(set_, window_, frame_.sensor_z_m, options_, changed_,
                         static_cast<std::int32_t>(desk.rows.begin),
                         static_cast<std::int32_t>(desk.rows.end), layers_);
  });
}

// Leaves the cells to be cleared on the desks.
void CpuMapper::FindCleared() {
  team_.Run([&](int i) {
    const auto thread = static_cast<std::size_t>(i);
    cpu::AddStrays(parts_, thread, rays_);
    rays_.Complete(set_, sectors_[thread]);
    Desk& desk = desks_[static_cast<std::size_t>(i)];
    cpu::FindCandidates(set_, window_, layers_, options_.traversability_free, changed_,
                        static_cast<std::int32_t>(desk.rows.begin),
                        static_cast<std::int32_t>(desk.rows.end), desk.candidates);
  });
  team_.Run([&](int i) {
    Desk& desk = desks_[static_cast<std::size_t>(i)];
    desk.cleared.clear();
    cpu::FindPassedBelow(set_, rays_, frame_, options_, desk.candidates, desk.cleared);
  });
}

// The cell begins anew from what points of this scan it has.
void CpuMapper::ClearCell(Place place, ScanReport& report) {
  const std::uint32_t index = window_.IndexOf(place);
  layers_.Forget(window_.SlotOf(place));
  changed_[index] = 1;
  for (Desk& desk : desks_) {
    const std::uint32_t rank = desk.sorted.RankOf(index);
    if (rank == 0) continue;
    // The cell was not confirmed, so all its points were counted as gated.
    const FuseOutcome outcome = cpu::FuseRank(Target(), desk.sorted, rank - 1, desk.hits);
    report.points_fused += outcome.fused;
    report.points_gated -= outcome.fused;
  }
}

void CpuMapper::Clear(ScanReport& report) {
  FindCleared();
  for (const Desk& desk : desks_) report.cells_cleared += desk.cleared.size();
  if (report.cells_cleared > 0) {
    std::fill(changed_.begin(), changed_.end(), std::uint8_t{0});
    for (const Desk& desk : desks_)
      for (const Place place : desk.cleared) ClearCell(place, report);
    AnnotateAroundChanged();
  }
  for (Desk& desk : desks_) desk.sorted.Clear();
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
    for (std::int32_t column = 0; column < side; ++column) {
      map.state[window_.IndexOf(
          {static_cast<std::int16_t>(column), static_cast<std::int16_t>(row)})] =
          layers_.StateAt(window_.SlotAt(column, row));
    }
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

std::unique_ptr<LocalMapper> MakeCpuMapper(const LocalMapOptions& options, int threads,
                                           VectorSet set) {
  return std::make_unique<CpuMapper>(options, threads, set);
}

}  // namespace gem
