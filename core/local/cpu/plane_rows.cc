#include "core/local/cpu/plane_rows.h"

#include <algorithm>
#include <cstring>

namespace gem::cpu {
namespace {

constexpr std::int32_t kMargin = kPlaneRadius_cells;
// Dirty cells nearer to each other than this are annotated in one go.
constexpr std::int32_t kGap = 16;

}  // namespace

PlaneRows::PlaneRows(std::int32_t side_cells) : side_cells_(side_cells) {
  const auto side = static_cast<std::size_t>(side_cells);
  const std::size_t padded = side + 2 * kLanes;
  static_assert(kLanes >= 2 * kMargin);
  for (Row& row : rows_) {
    row.height_m.resize(padded);
    row.known.resize(padded);
  }
  outside_ = rows_[0];
  near_rows_.resize(padded);
  dirty_.resize(side);
  for (auto* sums : {&count_, &y_, &yy_}) sums->resize(padded);
  for (auto* sums : {&z_, &yz_, &zz_}) sums->resize(padded);
  for (auto* values : {&num_cells_, &valid_, &stored_}) values->resize(padded);
  for (auto* values :
       {&rise_x_m_, &rise_y_m_, &squares_m2_, &slope_rad_, &roughness_m_, &traversability_}) {
    values->resize(padded);
  }
}

void PlaneRows::Annotate(VectorSet set, const RingWindow& window, float reference_m,
                         const LocalMapOptions& options, std::span<const std::uint8_t> changed,
                         std::int32_t row_begin, std::int32_t row_end, Layers& layers) {
  window_ = &window;
  options_ = &options;
  layers_ = &layers;
  reference_m_ = reference_m;
  for (Row& row : rows_) row.row = -1;
  RunVectorised(set, [&] {
    for (std::int32_t row = row_begin; row < row_end; ++row) {
      if (FindDirty(changed, row)) AnnotateRow(row);
    }
  });
}

bool PlaneRows::FindDirty(std::span<const std::uint8_t> changed, std::int32_t row) {
  const auto side = static_cast<std::size_t>(side_cells_);
  std::uint8_t* near_rows = near_rows_.data() + kMargin;
  bool any = false;
  const std::int32_t end = std::min(row + kMargin + 1, side_cells_);
  for (std::int32_t near = std::max(row - kMargin, 0); near < end; ++near) {
    const std::uint8_t* in_row = changed.data() + static_cast<std::size_t>(near) * side;
    if (std::memchr(in_row, 1, side) == nullptr) continue;
    if (!any) std::fill_n(near_rows, side, std::uint8_t{0});
    any = true;
    for (std::size_t i = 0; i < side; ++i) near_rows[i] |= in_row[i];
  }
  if (!any) return false;
  std::uint8_t* __restrict dirty = dirty_.data();
  const std::uint8_t* near = near_rows_.data();
  for (std::size_t i = 0; i < side; ++i) {
    dirty[i] = near[i] | near[i + 1] | near[i + 2] | near[i + 3] | near[i + 4];
  }
  return true;
}

const PlaneRows::Row& PlaneRows::RowAt(std::int32_t row) {
  if (row < 0 || row >= side_cells_) return outside_;
  Row& kept = rows_[static_cast<std::size_t>(row % kRows)];
  if (kept.row == row) return kept;
  kept.row = row;
  // A row of the window is two runs of its row in the ring: from the seam on, and before it.
  const std::int32_t seam = side_cells_ - FloorMod(window_->origin().x, side_cells_);
  const double reference_m = reference_m_;
  const auto copy = [&](std::int32_t begin, std::int32_t end) {
    if (begin == end) return;
    const std::uint32_t slot = window_->SlotAt(begin, row);
    const std::uint8_t* state = layers_->state.data() + slot;
    const float* elevation_m = layers_->elevation_m.data() + slot;
    std::int32_t* __restrict known = kept.known.data() + kMargin + begin;
    double* __restrict height_m = kept.height_m.data() + kMargin + begin;
    for (std::int32_t i = 0; i < end - begin; ++i) known[i] = state[i] & kCellKnown;
    for (std::int32_t i = 0; i < end - begin; ++i) {
      height_m[i] = known[i] != 0 ? elevation_m[i] - reference_m : 0.0;
    }
  };
  copy(0, seam);
  copy(seam, side_cells_);
  return kept;
}

void PlaneRows::AnnotateRow(std::int32_t row) {
  // The first column from `begin` on, before `end`, that is dirty (1) or not (0); else `end`.
  const auto find = [this](int dirty, std::int32_t begin, std::int32_t end) {
    const std::uint8_t* from = dirty_.data() + begin;
    const void* found = std::memchr(from, dirty, static_cast<std::size_t>(end - begin));
    if (found == nullptr) return end;
    return begin + static_cast<std::int32_t>(static_cast<const std::uint8_t*>(found) - from);
  };
  const std::int32_t first = find(1, 0, side_cells_);
  std::int32_t end = first;  // the last dirty cell is before it
  for (std::int32_t begin = first; begin < side_cells_; begin = find(1, end, side_cells_)) {
    end = begin;
    for (std::int32_t next = begin; next < std::min(end + kGap, side_cells_);
         next = find(1, end, std::min(end + kGap, side_cells_))) {
      end = find(0, next, side_cells_);
    }
    const std::int32_t num_lanes = (end - begin + kLanes - 1) / kLanes;
    SumColumns(row, begin, num_lanes);
    FitCells(begin, num_lanes);
    JudgeCells(begin, num_lanes);
  }
  Store(row, first, end);
}

void PlaneRows::SumColumns(std::int32_t row, std::int32_t begin, std::int32_t num_lanes) {
  const Row& r0 = RowAt(row - 2);
  const Row& r1 = RowAt(row - 1);
  const Row& r2 = RowAt(row);
  const Row& r3 = RowAt(row + 1);
  const Row& r4 = RowAt(row + 2);
  const std::int32_t *k0 = r0.known.data(), *k1 = r1.known.data(), *k2 = r2.known.data(),
                     *k3 = r3.known.data(), *k4 = r4.known.data();
  const double *h0 = r0.height_m.data(), *h1 = r1.height_m.data(), *h2 = r2.height_m.data(),
               *h3 = r3.height_m.data(), *h4 = r4.height_m.data();
  std::int32_t* __restrict count = count_.data(), * __restrict y = y_.data(), * __restrict yy = yy_.data();
  double* __restrict z = z_.data(), * __restrict yz = yz_.data(), * __restrict zz = zz_.data();
  const std::int32_t end = begin + (num_lanes + 1) * kLanes;  // the last cells' neighbours, too
  // Two loops, as integers and doubles differ in width. Heights of unknown cells are zero already.
  GEM_INDEPENDENT
  for (std::int32_t i = begin; i < end; ++i) {
    ColumnSums column;
    column.Add(-2, k0[i] != 0, 0);
    column.Add(-1, k1[i] != 0, 0);
    column.Add(0, k2[i] != 0, 0);
    column.Add(1, k3[i] != 0, 0);
    column.Add(2, k4[i] != 0, 0);
    count[i] = column.count;
    y[i] = column.y;
    yy[i] = column.yy;
  }
  GEM_INDEPENDENT
  for (std::int32_t i = begin; i < end; ++i) {
    ColumnSums column;
    column.Add(-2, true, h0[i]);
    column.Add(-1, true, h1[i]);
    column.Add(0, true, h2[i]);
    column.Add(1, true, h3[i]);
    column.Add(2, true, h4[i]);
    z[i] = column.z;
    yz[i] = column.yz;
    zz[i] = column.zz;
  }
}

void PlaneRows::FitCells(std::int32_t begin, std::int32_t num_lanes) {
  const std::int32_t end = begin + num_lanes * kLanes;
  const std::int32_t cells_min = options_->plane_cells_min;
  const std::int32_t *count = count_.data(), *y = y_.data(), *yy = yy_.data();
  const double *z = z_.data(), *yz = yz_.data(), *zz = zz_.data();
  std::int32_t *num_cells = num_cells_.data(), *valid = valid_.data();
  float *rise_x_m = rise_x_m_.data(), *rise_y_m = rise_y_m_.data();
  float* squares_m2 = squares_m2_.data();
  GEM_INDEPENDENT
  for (std::int32_t i = begin; i < end; ++i) {
    PlaneSums sums;
    const auto add = [&](std::int32_t dx) {
      const std::int32_t at = i + kMargin + dx;
      sums.Add(dx, {count[at], y[at], yy[at], z[at], yz[at], zz[at]});
    };
    add(-2);
    add(-1);
    add(0);
    add(1);
    add(2);
    const PlaneFit fit = FitPlane(sums);
    valid[i] = HasPlane(sums, cells_min) ? 1 : 0;
    num_cells[i] = sums.count;
    rise_x_m[i] = fit.rise_x_m;
    rise_y_m[i] = fit.rise_y_m;
    squares_m2[i] = fit.squares_m2;
  }
}

// Apart from FitCells, as each cell is a long chain of roots and quotients: the shorter the loop,
// the more of them the processor has in hand at once.
void PlaneRows::JudgeCells(std::int32_t begin, std::int32_t num_lanes) {
  const std::int32_t end = begin + num_lanes * kLanes;
  const LocalMapOptions options = *options_;
  const std::int32_t *num_cells = num_cells_.data(), *valid = valid_.data();
  const float *rise_x_m = rise_x_m_.data(), *rise_y_m = rise_y_m_.data();
  const float* squares_m2 = squares_m2_.data();
  float *slope_rad = slope_rad_.data(), *roughness_m = roughness_m_.data();
  float* traversability = traversability_.data();
  GEM_INDEPENDENT
  for (std::int32_t i = begin; i < end; ++i) {
    const PlaneFit fit{rise_x_m[i], rise_y_m[i], squares_m2[i]};
    const bool has_plane = valid[i] != 0;
    const float slope = SlopeOf(fit, options.cell_size_m);
    const float roughness = RoughnessOf(fit, num_cells[i]);
    const float score = TraversabilityOf(slope, roughness, options);
    slope_rad[i] = has_plane ? slope : 0.0f;
    roughness_m[i] = has_plane ? roughness : 0.0f;
    traversability[i] = has_plane ? score : 0.0f;
  }
}

void PlaneRows::Store(std::int32_t row, std::int32_t begin, std::int32_t end) {
  // A row of the window is two runs of its row in the ring: from the seam on, and before it.
  const std::int32_t seam = side_cells_ - FloorMod(window_->origin().x, side_cells_);
  StoreRun(row, begin, std::min(end, seam));
  StoreRun(row, std::max(begin, seam), end);
}

void PlaneRows::StoreRun(std::int32_t row, std::int32_t begin, std::int32_t end) {
  if (begin >= end) return;
  const std::uint32_t slot = window_->SlotAt(begin, row);
  const std::int32_t count = end - begin;
  const std::uint8_t* dirty = dirty_.data() + begin;
  const std::int32_t* known = RowAt(row).known.data() + kMargin + begin;
  const std::int32_t* valid = valid_.data() + begin;
  std::int32_t* stored = stored_.data();
  std::uint8_t* annotated = layers_->annotated.data() + slot;
  GEM_INDEPENDENT
  for (std::int32_t i = 0; i < count; ++i) {
    stored[i] = dirty[i] & known[i];
    const std::int32_t now = valid[i] != 0 ? kCellAnnotated : 0;
    annotated[i] = static_cast<std::uint8_t>(stored[i] != 0 ? now : annotated[i]);
  }
  const auto store = [&](const std::vector<float>& from, std::vector<float>& to) {
    const float* values = from.data() + begin;
    float* layer = to.data() + slot;
    GEM_INDEPENDENT
    for (std::int32_t i = 0; i < count; ++i) layer[i] = stored[i] != 0 ? values[i] : layer[i];
  };
  store(slope_rad_, layers_->slope_rad);
  store(roughness_m_, layers_->roughness_m);
  store(traversability_, layers_->traversability);
}

}  // namespace gem::cpu
