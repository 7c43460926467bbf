// A finished submap (paper section V-A): rigid, immutable, compact. Points never move in it; its
// pose does.
//
// Layout: 16x16-cell groups, each with a 256-bit occupancy bitmap and the position of its first
// cell in flat arrays that hold known cells only; a table over the bounding rectangle says which
// group is where. A look-up is a bitmap test and a popcount: no key is stored per cell.
#pragma once

#include <Eigen/Core>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "core/geometry/pose.h"
#include "core/global/sources.h"
#include "core/global/submap_part.h"
#include "core/grid/cell_belief.h"

namespace gem {

/// No submap is longer or wider than this many cells of K: a bound on the group table.
inline constexpr std::int32_t kSubmapSideCells_max = 1 << 14;
/// Cells a side of a group.
inline constexpr int kGroupBits = 4;
inline constexpr std::int32_t kGroupCells = 1 << kGroupBits;

/// Order of creation within a map; never reused.
enum class SubmapId : std::uint64_t {};

/// Upper triangle by rows of a symmetric 3x3 matrix: xx, xy, xz, yy, yz, zz. m^2.
using Covariance3 = std::array<float, 6>;

/// One cell of a submap. The point is (centre of cell, elevation_m) in K.
struct SubmapCell {
  float elevation_m = 0;        ///< over z = 0 of K
  Covariance3 covariance_m2{};  ///< of the point, in K, eq. (11)
  float traversability = 0;     ///< kept in 1/255, rounded down: never freer than it is
  Rgba rgba = 0;
  std::int64_t stamp_ns = 0;  ///< last observation; kept in milliseconds, rounded down
  std::uint8_t state = 0;     ///< CellState bits; kCellKnown is always set
  friend bool operator==(const SubmapCell&, const SubmapCell&) = default;
};

struct KeyedSubmapCell {
  CellIndex cell;  ///< in K
  SubmapCell value;
  SourceIndex source = 0;  ///< of the submap's sources
};

/// Where a submap hangs and who made it.
struct SubmapOrigin {
  SubmapId id{};
  std::string session;               ///< whose trajectory carries it
  std::string robot;                 ///< of that session
  std::int64_t anchor_stamp_ns = 0;  ///< stamp of the trajectory pose that carries it
  Pose<Odom, Submap> T_O_K;          ///< axes of O, origin on a cell corner of O
  float cell_size_m = 0;
};

class Submap {
 public:
  /// Cells of a group, 16x16 by row: what is known of them and how high they are.
  struct Group {
    std::array<std::uint64_t, 4> occupied{};  ///< bit: row in group * 16 + column in group
    std::uint32_t first = 0;                  ///< position of its first cell
    std::array<std::uint8_t, 4> before{};     ///< cells in the words before a word
    float elevation_m_min = 0;
    float elevation_m_max = 0;
    CellIndex origin;  ///< its lower left cell

    std::size_t num_cells() const {
      std::size_t count = 0;
      for (const std::uint64_t word : occupied)
        count += static_cast<std::size_t>(std::popcount(word));
      return count;
    }
    /// Calls visit(CellIndex, position) for each of its cells, by row, then column.
    template <typename Visit>
    void ForEachCell(const Visit& visit) const {
      std::size_t position = first;
      for (std::int32_t i = 0; i < 4; ++i) {
        for (std::uint64_t word = occupied[static_cast<std::size_t>(i)]; word != 0;
             word &= word - 1) {
          const std::int32_t bit = i * 64 + std::countr_zero(word);
          visit(CellIndex{origin.x + (bit & (kGroupCells - 1)), origin.y + (bit >> kGroupBits)},
                position++);
        }
      }
    }
  };

  /// All of it its session's own. cells: each cell at most once, any order; within
  /// kSubmapSideCells_max of each other.
  Submap(SubmapOrigin origin, const std::vector<KeyedSubmapCell>& cells);

  /// The same with given parts(), as what was merged into a submap does not move it, and with what
  /// came from whom.
  Submap(SubmapOrigin origin, const std::vector<KeyedSubmapCell>& cells,
         std::vector<SubmapPart> parts, Sources sources);

  const SubmapOrigin& origin() const { return origin_; }
  std::size_t num_cells() const { return elevation_m_.size(); }
  bool empty() const { return num_cells() == 0; }
  /// Everything the submap occupies.
  std::size_t size_bytes() const;
  /// Smallest rectangle of cells of K that holds all cells.
  const CellRect& rect() const { return rect_; }
  /// Groups that hold a cell, by row, then column.
  const std::vector<Group>& groups() const { return groups_; }
  /// What its session mapped, in at most 8 by 8 pieces, by row, then column: what a correction
  /// moves it by. At least one in a submap that is not empty.
  const std::vector<SubmapPart>& parts() const { return parts_; }
  float elevation_m_min() const { return elevation_m_min_; }
  float elevation_m_max() const { return elevation_m_max_; }
  std::int64_t first_stamp_ns() const { return first_stamp_ns_; }
  std::int64_t last_stamp_ns() const { return last_stamp_ns_; }

  /// The group that a cell belongs to; null if it holds no known cell.
  const Group* FindGroup(CellIndex cell) const {
    const std::int32_t column = (cell.x >> kGroupBits) - group_min_.x;
    const std::int32_t row = (cell.y >> kGroupBits) - group_min_.y;
    if (column < 0 || column >= group_columns_ || row < 0 || row >= group_rows_) return nullptr;
    const std::int32_t index =
        group_index_[static_cast<std::size_t>(row * group_columns_ + column)];
    return index < 0 ? nullptr : &groups_[static_cast<std::size_t>(index)];
  }
  /// Position of a cell in the arrays, or nothing if it is not known. Constant time.
  std::optional<std::size_t> Find(CellIndex cell) const {
    const Group* found = FindGroup(cell);
    if (found == nullptr) return std::nullopt;
    const Group& group = *found;
    const int bit = BitInGroup(cell);
    const std::uint64_t word = group.occupied[static_cast<std::size_t>(bit >> 6)];
    const std::uint64_t mask = std::uint64_t{1} << (bit & 63);
    if ((word & mask) == 0) return std::nullopt;
    return group.first + group.before[static_cast<std::size_t>(bit >> 6)] +
           static_cast<std::size_t>(std::popcount(word & (mask - 1)));
  }
  /// False only if no cell of the rectangle is known; looks at groups, not at cells.
  bool MayKnowAnyOf(const CellRect& rect) const;
  float elevation_m(std::size_t position) const { return elevation_m_[position]; }
  const Covariance3& covariance_m2(std::size_t position) const { return covariance_m2_[position]; }
  SubmapCell At(std::size_t position) const;
  /// Who contributed to a cell: one of sources().
  SourceIndex source(std::size_t position) const {
    if (source_low_.empty()) return 0;
    return static_cast<SourceIndex>(source_low_[position] |
                                    (source_high_.empty() ? 0 : source_high_[position] << 8));
  }
  /// The sets of contributors that cells have, sorted: the same for equal contents.
  const Sources& sources() const { return sources_; }
  /// All cells by group, then row, then column: the same for equal contents.
  std::vector<KeyedSubmapCell> Cells() const;

 private:
  static int BitInGroup(CellIndex cell) {
    return ((cell.y & (kGroupCells - 1)) << kGroupBits) | (cell.x & (kGroupCells - 1));
  }
  void BuildGroups(const std::vector<KeyedSubmapCell>& cells);
  void Place(std::size_t position, const SubmapCell& cell);
  /// Keeps those of the sources that cells have, in order.
  void PlaceSources(const std::vector<KeyedSubmapCell>& cells, Sources sources);
  std::vector<SubmapPart> FindParts() const;

  // Constant after construction.
  SubmapOrigin origin_;
  CellRect rect_;
  CellIndex group_min_;  ///< of the table; group coordinates: cell >> 4
  std::int32_t group_columns_ = 0;
  std::int32_t group_rows_ = 0;
  std::vector<std::int32_t> group_index_;  ///< by row, then column: position in groups_, or -1
  std::vector<Group> groups_;
  std::vector<SubmapPart> parts_;
  std::vector<float> elevation_m_;
  std::vector<Covariance3> covariance_m2_;
  std::vector<Rgba> rgba_;  ///< colour in the lower 24 bits, CellState in the upper 8
  std::vector<std::uint8_t> traversability_;  ///< 0..255
  /// Whole milliseconds since stamp_base_ns_, rounded down. 49 days fit; a cell older than that
  /// beside a newer one (after a merge) counts as 49 days old.
  std::vector<std::uint32_t> stamp_ms_;
  Sources sources_;
  std::vector<std::uint8_t> source_low_;   ///< empty: all cells have the only one
  std::vector<std::uint8_t> source_high_;  ///< empty: there are at most 256
  std::int64_t stamp_base_ns_ = 0;  ///< a multiple of 1 ms, so that rounding twice changes nothing
  float elevation_m_min_ = 0;
  float elevation_m_max_ = 0;
  std::int64_t first_stamp_ns_ = 0;
  std::int64_t last_stamp_ns_ = 0;
};

}  // namespace gem
