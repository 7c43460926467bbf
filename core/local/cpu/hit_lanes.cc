#include "core/local/cpu/hit_lanes.h"

#include <algorithm>
#include <array>

namespace gem::cpu {
namespace {

// Marks where the next hit of a long cell goes.
constexpr std::uint32_t kLongBit = 1u << 31;

}  // namespace

HitLanes::HitLanes(std::size_t num_cells)
    : listed_(num_cells),
      listed_count_(num_cells),
      cells_(num_cells + kLanes),
      counts_(num_cells + kLanes),
      begins_(num_cells),
      rank_of_cell_(num_cells),
      next_(num_cells) {}

void HitLanes::Sort(std::span<MeasuredPart> parts, std::span<const HitRun> runs,
                    std::uint32_t begin, std::uint32_t end) {
  is_colored_ = false;
  for (const MeasuredPart& part : parts) is_colored_ = is_colored_ || part.is_colored;
  ListCells(parts, begin, end);
  RankCells();
  PlaceCells();
  for (const HitRun& run : runs) Deal(run, begin, end);
}

void HitLanes::Clear() {
  for (std::size_t rank = 0; rank < num_cells_; ++rank) rank_of_cell_[cells_[rank]] = 0;
  num_cells_ = num_long_ = 0;
}

void HitLanes::ListCells(std::span<MeasuredPart> parts, std::uint32_t begin, std::uint32_t end) {
  std::size_t listed = 0;
  for (std::uint32_t cell = begin; cell < end; ++cell) {
    std::uint32_t count = 0;
    for (const MeasuredPart& part : parts) count += part.count_of_cell[cell];
    listed_[listed] = cell;
    listed_count_[listed] = count;
    listed += count != 0 ? 1 : 0;  // else the next one takes the place
  }
  num_cells_ = listed;
  for (MeasuredPart& part : parts) {
    std::fill(part.count_of_cell.begin() + begin, part.count_of_cell.begin() + end, 0u);
  }
}

// Counting sort by descending number of hits.
void HitLanes::RankCells() {
  std::array<std::uint32_t, kLongCount + 1> begins{};
  const auto bucket_of = [](std::uint32_t count) {
    return count < kLongCount ? kLongCount - count : 0;
  };
  for (std::size_t i = 0; i < num_cells_; ++i) ++begins[bucket_of(listed_count_[i])];
  num_long_ = begins[0];
  std::uint32_t rank = 0;
  for (std::uint32_t& begin : begins) {
    const std::uint32_t size = begin;
    begin = rank;
    rank += size;
  }
  for (std::size_t i = 0; i < num_cells_; ++i) {
    const std::uint32_t at = begins[bucket_of(listed_count_[i])]++;
    cells_[at] = listed_[i];
    counts_[at] = listed_count_[i];
    rank_of_cell_[listed_[i]] = at + 1;
  }
  // Lanes without a cell look at the last one: what lies elsewhere may be another thread's.
  if (num_cells_ > 0) std::fill_n(cells_.begin() + num_cells_, kLanes, cells_[num_cells_ - 1]);
}

void HitLanes::PlaceCells() {
  std::uint32_t size = 0;
  for (std::size_t rank = 0; rank < num_long_; ++rank) {
    begins_[rank] = size;
    next_[cells_[rank]] = size | kLongBit;
    size += 2 * counts_[rank];
  }
  for (std::size_t first = num_long_; first < num_cells_; first += kLanes) {
    const std::size_t end = std::min(first + kLanes, num_cells_);
    for (std::size_t rank = first; rank < end; ++rank) {
      begins_[rank] = size + static_cast<std::uint32_t>(rank - first);
      next_[cells_[rank]] = begins_[rank];
    }
    size += 2 * std::uint32_t{kLanes} * counts_[first];  // the longest of the group
  }
  if (heights_.size() < size) heights_.resize(size);
  if (is_colored_ && rgba_.size() < size) rgba_.resize(heights_.size());
}

void HitLanes::Deal(const HitRun& run, std::uint32_t begin, std::uint32_t end) {
  if (run.cell_max < begin || run.cell_min >= end) return;
  const MeasuredPart& part = *run.part;
  float* heights = heights_.data();
  std::uint32_t* next = next_.data();
  for (std::size_t i = run.begin; i < run.end; ++i) {
    const std::uint32_t cell = part.cell[i];
    if (cell - begin >= end - begin) continue;  // also below: it wraps
    const std::uint32_t marked = next[cell];
    const std::uint32_t lanes = (marked & kLongBit) != 0 ? 1 : kLanes;
    next[cell] = marked + 2 * lanes;
    const std::uint32_t at = marked & ~kLongBit;
    heights[at] = part.elevation_m[i];
    heights[at + lanes] = part.variance_m2[i];
    if (is_colored_) rgba_[at] = part.is_colored ? part.rgba[i] : 0;
  }
}

std::span<const Hit> HitLanes::HitsOf(std::size_t rank, std::vector<Hit>& buffer) const {
  const std::size_t lanes = rank < num_long_ ? 1 : kLanes;
  const std::size_t count = counts_[rank];
  if (buffer.size() < count) buffer.resize(count);
  for (std::size_t k = 0; k < count; ++k) {
    const std::size_t at = begins_[rank] + k * 2 * lanes;
    buffer[k] = {{heights_[at], heights_[at + lanes]}, is_colored_ ? rgba_[at] : 0};
  }
  return {buffer.data(), count};
}

}  // namespace gem::cpu
