#include "core/local/cpu/plane_rows.h"

#include <algorithm>
#include <cstring>

namespace gem::cpu {
namespace {

constexpr std::int32_t kMargin = kPlaneRadius_cells;
// Dirty cells nearer to each other than this are annotated in one go.
constexpr std::int32_t kGap = 8;

}  // namespace

PlaneRows::PlaneRows(std::int32_t side_cells) : side_cells_(side_cells) {
  const auto side = static_cast<std::size_t>(side_cells);
  const auto padded = side + 2 * kMargin;
  for (Row& row : rows_) {
    row.height_m.resize(padded);
    row.known.resize(padded);
  }
  outside_ = rows_[0];
  near_rows_.resize(padded);
  dirty_.resize(side + kGap);
  for (auto* sums : {&count_, &y_, &yy_}) sums->resize(padded);
  for (auto* sums : {&z_, &yz_, &zz_}) sums->resize(padded);
  valid_.resize(side);
  for (auto* layer : {&slope_rad_, &roughness_m_, &traversability_}) layer->resize(side);
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
  std::int32_t begin = 0;
  while (begin < side_cells_) {
    const auto* found = static_cast<const std::uint8_t*>(
        std::memchr(dirty_.data() + begin, 1, static_cast<std::size_t>(side_cells_ - begin)));
    if (found == nullptr) return;
    begin = static_cast<std::int32_t>(found - dirty_.data());
    std::int32_t end = begin + 1;  // the last dirty cell is before it
    for (std::int32_t i = end; i < std::min(end + kGap, side_cells_); ++i) {
      if (dirty_[static_cast<std::size_t>(i)] != 0) end = i + 1;
    }
    SumColumns(row, begin, end);
    FitCells(begin, end);
    Store(row, begin, end);
    begin = end;
  }
}

void PlaneRows::SumColumns(std::int32_t row, std::int32_t begin, std::int32_t end) {
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
  // Two loops, as integers and doubles differ in width. Heights of unknown cells are zero already.
  GEM_INDEPENDENT
  for (std::int32_t i = begin; i < end + 2 * kMargin; ++i) {
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
  for (std::int32_t i = begin; i < end + 2 * kMargin; ++i) {
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

void PlaneRows::FitCells(std::int32_t begin, std::int32_t end) {
  const LocalMapOptions options = *options_;
  const std::int32_t *count = count_.data(), *y = y_.data(), *yy = yy_.data();
  const double *z = z_.data(), *yz = yz_.data(), *zz = zz_.data();
  std::int32_t* __restrict valid = valid_.data();
  float *__restrict slope_rad = slope_rad_.data(), *__restrict roughness_m = roughness_m_.data(),
                    *__restrict traversability = traversability_.data();
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
    const bool has_plane = HasPlane(sums, options.plane_cells_min);
    const PlaneFit fit = FitPlane(sums);
    const float slope = SlopeOf(fit, options.cell_size_m);
    const float score = TraversabilityOf(slope, fit.roughness_m, options);
    valid[i] = has_plane ? 1 : 0;
    slope_rad[i] = has_plane ? slope : 0.0f;
    roughness_m[i] = has_plane ? fit.roughness_m : 0.0f;
    traversability[i] = has_plane ? score : 0.0f;
  }
}

void PlaneRows::Store(std::int32_t row, std::int32_t begin, std::int32_t end) {
  for (std::int32_t column = begin; column < end; ++column) {
    const auto i = static_cast<std::size_t>(column);
    const std::uint32_t slot = window_->SlotAt(column, row);
    std::uint8_t& state = layers_->state[slot];
    if (dirty_[i] == 0 || (state & kCellKnown) == 0) continue;
    state = static_cast<std::uint8_t>((state & ~kCellAnnotated) |
                                      (valid_[i] != 0 ? kCellAnnotated : 0));
    layers_->slope_rad[slot] = slope_rad_[i];
    layers_->roughness_m[slot] = roughness_m_[i];
    layers_->traversability[slot] = traversability_[i];
  }
}

}  // namespace gem::cpu
