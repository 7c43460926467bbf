#include "core/global/submap.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "core/base/check.h"

namespace gem {
namespace {

constexpr std::int64_t kNsPerMs = 1'000'000;
constexpr std::int64_t kStampSpan_ns = std::numeric_limits<std::uint32_t>::max() * kNsPerMs;

std::int64_t FloorToMs(std::int64_t stamp_ns) {
  const std::int64_t remainder = stamp_ns % kNsPerMs;
  return stamp_ns - (remainder < 0 ? remainder + kNsPerMs : remainder);
}

// The small addend lets n / 255 in float come back as n, not as n - 1.
std::uint8_t QuantiseTraversability(float traversability) {
  const float steps = std::clamp(traversability, 0.0f, 1.0f) * 255.0f + 1e-3f;
  return static_cast<std::uint8_t>(steps);
}

CellRect BoundsOf(const std::vector<KeyedSubmapCell>& cells) {
  if (cells.empty()) return {};
  CellRect rect{cells.front().cell, cells.front().cell};
  for (const KeyedSubmapCell& keyed : cells) {
    rect.min = {std::min(rect.min.x, keyed.cell.x), std::min(rect.min.y, keyed.cell.y)};
    rect.max = {std::max(rect.max.x, keyed.cell.x), std::max(rect.max.y, keyed.cell.y)};
  }
  GEM_CHECK(static_cast<std::int64_t>(rect.max.x) - rect.min.x < kSubmapSideCells_max);
  GEM_CHECK(static_cast<std::int64_t>(rect.max.y) - rect.min.y < kSubmapSideCells_max);
  rect.max = {rect.max.x + 1, rect.max.y + 1};
  return rect;
}

}  // namespace

Submap::Submap(SubmapOrigin origin, const std::vector<KeyedSubmapCell>& cells)
    : Submap(std::move(origin), cells, {}, {}) {
  sources_ = {{{origin_.session, origin_.robot}}};
  parts_ = FindParts();
}

Submap::Submap(SubmapOrigin origin, const std::vector<KeyedSubmapCell>& cells,
               std::vector<SubmapPart> parts, Sources sources)
    : origin_(std::move(origin)), rect_(BoundsOf(cells)), parts_(std::move(parts)) {
  if (cells.empty()) return;
  BuildGroups(cells);

  first_stamp_ns_ = last_stamp_ns_ = cells.front().value.stamp_ns;
  for (const KeyedSubmapCell& keyed : cells) {
    first_stamp_ns_ = std::min(first_stamp_ns_, keyed.value.stamp_ns);
    last_stamp_ns_ = std::max(last_stamp_ns_, keyed.value.stamp_ns);
  }
  // Unsigned, so that stamps at both ends of the range do not overflow.
  const bool spans =
      static_cast<std::uint64_t>(last_stamp_ns_) - static_cast<std::uint64_t>(first_stamp_ns_) <
      static_cast<std::uint64_t>(kStampSpan_ns);
  stamp_base_ns_ = FloorToMs(spans ? first_stamp_ns_ : last_stamp_ns_ - kStampSpan_ns + kNsPerMs);

  elevation_m_.resize(cells.size());
  covariance_m2_.resize(cells.size());
  rgba_.resize(cells.size());
  traversability_.resize(cells.size());
  stamp_ms_.resize(cells.size());
  for (const KeyedSubmapCell& keyed : cells) Place(*Find(keyed.cell), keyed.value);
  if (!sources.empty()) PlaceSources(cells, std::move(sources));

  for (const KeyedSubmapCell& keyed : cells) {
    const CellIndex in_table{(keyed.cell.x >> kGroupBits) - group_min_.x,
                             (keyed.cell.y >> kGroupBits) - group_min_.y};
    const std::size_t slot = static_cast<std::size_t>(in_table.y * group_columns_ + in_table.x);
    Group& group = groups_[static_cast<std::size_t>(group_index_[slot])];
    group.elevation_m_min = std::min(group.elevation_m_min, keyed.value.elevation_m);
    group.elevation_m_max = std::max(group.elevation_m_max, keyed.value.elevation_m);
  }
  elevation_m_min_ = *std::min_element(elevation_m_.begin(), elevation_m_.end());
  elevation_m_max_ = *std::max_element(elevation_m_.begin(), elevation_m_.end());
}

void Submap::BuildGroups(const std::vector<KeyedSubmapCell>& cells) {
  group_min_ = {rect_.min.x >> kGroupBits, rect_.min.y >> kGroupBits};
  group_columns_ = ((rect_.max.x - 1) >> kGroupBits) - group_min_.x + 1;
  group_rows_ = ((rect_.max.y - 1) >> kGroupBits) - group_min_.y + 1;
  group_index_.assign(static_cast<std::size_t>(group_columns_ * group_rows_), -1);

  const auto slot_of = [this](CellIndex cell) {
    return static_cast<std::size_t>(((cell.y >> kGroupBits) - group_min_.y) * group_columns_ +
                                    (cell.x >> kGroupBits) - group_min_.x);
  };
  for (const KeyedSubmapCell& keyed : cells) group_index_[slot_of(keyed.cell)] = 0;
  std::int32_t num_groups = 0;
  for (std::int32_t& index : group_index_)
    if (index == 0) index = num_groups++;
  groups_.resize(static_cast<std::size_t>(num_groups));

  for (const KeyedSubmapCell& keyed : cells) {
    Group& group = groups_[static_cast<std::size_t>(group_index_[slot_of(keyed.cell)])];
    const int bit = BitInGroup(keyed.cell);
    const std::uint64_t mask = std::uint64_t{1} << (bit & 63);
    std::uint64_t& word = group.occupied[static_cast<std::size_t>(bit >> 6)];
    GEM_CHECK((word & mask) == 0);  // each cell at most once
    word |= mask;
    group.origin = {keyed.cell.x & ~(kGroupCells - 1), keyed.cell.y & ~(kGroupCells - 1)};
  }
  std::uint32_t first = 0;
  for (Group& group : groups_) {
    group.first = first;
    for (std::size_t i = 0; i < group.occupied.size(); ++i) {
      group.before[i] = static_cast<std::uint8_t>(first - group.first);  // at most 192
      first += static_cast<std::uint32_t>(std::popcount(group.occupied[i]));
    }
    group.elevation_m_min = std::numeric_limits<float>::max();
    group.elevation_m_max = std::numeric_limits<float>::lowest();
  }
}

void Submap::Place(std::size_t position, const SubmapCell& cell) {
  const bool annotated = (cell.state & kCellAnnotated) != 0;
  const bool colored = (cell.state & kCellColored) != 0;
  elevation_m_[position] = cell.elevation_m;
  covariance_m2_[position] = cell.covariance_m2;
  rgba_[position] = (colored ? cell.rgba & 0xffffffu : 0u) |
                    (static_cast<std::uint32_t>(cell.state | kCellKnown) << 24);
  traversability_[position] = annotated ? QuantiseTraversability(cell.traversability) : 0;
  const std::int64_t since_base_ns = std::max(cell.stamp_ns, stamp_base_ns_) - stamp_base_ns_;
  stamp_ms_[position] = static_cast<std::uint32_t>(since_base_ns / kNsPerMs);
}

void Submap::PlaceSources(const std::vector<KeyedSubmapCell>& cells, Sources sources) {
  std::vector<bool> used(sources.size());
  for (const KeyedSubmapCell& keyed : cells) used[keyed.source] = true;
  std::vector<SourceIndex> order;
  for (std::size_t i = 0; i < sources.size(); ++i)
    if (used[i]) order.push_back(static_cast<SourceIndex>(i));
  std::sort(order.begin(), order.end(),
            [&](SourceIndex a, SourceIndex b) { return sources[a] < sources[b]; });
  std::vector<SourceIndex> place_of(sources.size());
  sources_.reserve(order.size());
  for (const SourceIndex index : order) {
    place_of[index] = static_cast<SourceIndex>(sources_.size());
    sources_.push_back(std::move(sources[index]));
  }
  if (sources_.size() > 1) source_low_.resize(cells.size());
  if (sources_.size() > 256) source_high_.resize(cells.size());
  if (source_low_.empty()) return;
  for (const KeyedSubmapCell& keyed : cells) {
    const std::size_t position = *Find(keyed.cell);
    const SourceIndex place = place_of[keyed.source];
    source_low_[position] = static_cast<std::uint8_t>(place & 0xff);
    if (!source_high_.empty()) source_high_[position] = static_cast<std::uint8_t>(place >> 8);
  }
}

// Summed by group and position, so that the order of the cells given does not show.
std::vector<SubmapPart> Submap::FindParts() const {
  constexpr std::int32_t kPartsSide_max = 8;
  int bits = 0;  // of a part's side in groups
  while ((std::max(group_columns_, group_rows_) - 1) >> bits >= kPartsSide_max) ++bits;
  const double side_m = (kGroupCells << bits) * static_cast<double>(origin_.cell_size_m);
  struct Sum {
    Eigen::Vector3d places_m = Eigen::Vector3d::Zero();
    double since_base_ms = 0;
    double num_cells = 0;
  };
  std::array<Sum, kPartsSide_max * kPartsSide_max> sums;
  for (const Group& group : groups_) {
    const std::int32_t column = ((group.origin.x >> kGroupBits) - group_min_.x) >> bits;
    const std::int32_t row = ((group.origin.y >> kGroupBits) - group_min_.y) >> bits;
    Sum& sum = sums[static_cast<std::size_t>(row * kPartsSide_max + column)];
    group.ForEachCell([&](CellIndex cell, std::size_t position) {
      sum.places_m += Eigen::Vector3d(CenterOf(cell.x, origin_.cell_size_m),
                                      CenterOf(cell.y, origin_.cell_size_m),
                                      static_cast<double>(elevation_m_[position]));
      sum.since_base_ms += stamp_ms_[position];
      sum.num_cells += 1;
    });
  }
  std::vector<SubmapPart> parts;
  for (const Sum& sum : sums) {
    if (sum.num_cells == 0) continue;
    const auto since_base_ms = static_cast<std::int64_t>(sum.since_base_ms / sum.num_cells);
    parts.push_back({Point<Submap>(sum.places_m / sum.num_cells), side_m * side_m / 12,
                     sum.num_cells, stamp_base_ns_ + since_base_ms * kNsPerMs});
  }
  return parts;
}

SubmapCell Submap::At(std::size_t position) const {
  SubmapCell cell;
  cell.state = static_cast<std::uint8_t>(rgba_[position] >> 24);
  cell.elevation_m = elevation_m_[position];
  cell.covariance_m2 = covariance_m2_[position];
  cell.traversability = static_cast<float>(traversability_[position]) / 255.0f;
  if ((cell.state & kCellColored) != 0) cell.rgba = rgba_[position] | 0xff000000u;
  cell.stamp_ns = stamp_base_ns_ + stamp_ms_[position] * kNsPerMs;
  return cell;
}

std::vector<KeyedSubmapCell> Submap::Cells() const {
  std::vector<KeyedSubmapCell> cells;
  cells.reserve(num_cells());
  for (const Group& group : groups_)
    group.ForEachCell([&](CellIndex cell, std::size_t position) {
      cells.push_back({cell, At(position), source(position)});
    });
  return cells;
}

bool Submap::MayKnowAnyOf(const CellRect& rect) const {
  const CellRect inside{{std::max(rect.min.x, rect_.min.x), std::max(rect.min.y, rect_.min.y)},
                        {std::min(rect.max.x, rect_.max.x), std::min(rect.max.y, rect_.max.y)}};
  if (inside.empty()) return false;
  for (std::int32_t y = inside.min.y >> kGroupBits; y <= (inside.max.y - 1) >> kGroupBits; ++y) {
    for (std::int32_t x = inside.min.x >> kGroupBits; x <= (inside.max.x - 1) >> kGroupBits; ++x) {
      const std::int32_t slot = (y - group_min_.y) * group_columns_ + x - group_min_.x;
      if (group_index_[static_cast<std::size_t>(slot)] >= 0) return true;
    }
  }
  return false;
}

std::size_t Submap::size_bytes() const {
  return sizeof(*this) + origin_.session.capacity() + origin_.robot.capacity() +
         SizeBytes(sources_) + source_low_.capacity() + source_high_.capacity() +
         group_index_.capacity() * sizeof(std::int32_t) + groups_.capacity() * sizeof(Group) +
         parts_.capacity() * sizeof(SubmapPart) + elevation_m_.capacity() * sizeof(float) +
         covariance_m2_.capacity() * sizeof(Covariance3) + rgba_.capacity() * sizeof(Rgba) +
         traversability_.capacity() + stamp_ms_.capacity() * sizeof(std::uint32_t);
}

}  // namespace gem
