// The hits of a scan in a band of the window, sorted by cell, stable, and laid out for vectors: 16
// cells make a group, and the k-th hits of a group's cells lie side by side. Cells with many hits
// come first, so that the cells of a group have about equally many.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/local/cpu/point_pass.h"
#include "core/local/fuse.h"

namespace gem::cpu {

class HitLanes {
 public:
  /// Cells of a group. Two vectors of AVX2, so that one computes while the other waits.
  static constexpr std::size_t kLanes = 16;
  /// Cells with at least so many hits are long: they stand alone, as the other lanes of a group
  /// would be padded to their length.
  static constexpr std::uint32_t kLongCount = 512;

  explicit HitLanes(std::size_t num_cells);

  /// Takes the hits whose window index is in [begin, end) from a scan's runs, which are in the
  /// order of its points, and leaves the counts of these cells in the parts zero. Threads may sort
  /// bands that do not overlap at once, each with its own HitLanes.
  void Sort(std::span<MeasuredPart> parts, std::span<const HitRun> runs, std::uint32_t begin,
            std::uint32_t end);
  /// Forgets all hits.
  void Clear();

  /// Cells with hits. The first num_long() ranks are long cells; then rank num_long() + r is lane r
  /// % kLanes of group r / kLanes.
  std::size_t num_cells() const { return num_cells_; }
  std::size_t num_long() const { return num_long_; }
  std::size_t num_groups() const { return (num_cells_ - num_long_ + kLanes - 1) / kLanes; }
  std::size_t FirstRankOf(std::size_t group) const { return num_long_ + group * kLanes; }
  /// Window index of the cell, and its hits.
  std::uint32_t CellOf(std::size_t rank) const { return cells_[rank]; }
  std::uint32_t CountOf(std::size_t rank) const { return counts_[rank]; }
  /// The same by rank, a group long also where the last group has fewer cells.
  const std::uint32_t* cells() const { return cells_.data(); }
  const std::uint32_t* counts() const { return counts_.data(); }
  /// Rank of the cell at a window index, plus one; 0 if it has no hits here.
  std::uint32_t RankOf(std::uint32_t cell) const { return rank_of_cell_[cell]; }
  bool is_colored() const { return is_colored_; }

  /// Heights of a group: the k-th hits of its lanes are at k * 2 * kLanes, variances kLanes later.
  const float* HeightsOf(std::size_t group) const {
    return heights_.data() + begins_[FirstRankOf(group)];
  }

  /// The hits of one cell in point order, in `buffer`, which grows if it must.
  std::span<const Hit> HitsOf(std::size_t rank, std::vector<Hit>& buffer) const;

 private:
  void ListCells(std::span<MeasuredPart> parts, std::uint32_t begin, std::uint32_t end);
  void RankCells();
  void PlaceCells();
  void Deal(const HitRun& run, std::uint32_t begin, std::uint32_t end);

  std::size_t num_cells_ = 0;
  std::size_t num_long_ = 0;
  bool is_colored_ = false;

  // Cells with hits by window index, and their hits.
  std::vector<std::uint32_t> listed_, listed_count_;
  // By rank; begins_ is where a cell's first elevation is in heights_.
  std::vector<std::uint32_t> cells_, counts_, begins_;
  std::vector<std::uint32_t> rank_of_cell_;  // plus one; all zero between scans

  std::vector<std::uint32_t> next_;  // where a cell's next hit goes, by window index
  std::vector<float> heights_;
  std::vector<Rgba> rgba_;  // where the elevation is; empty until there are colours
};

}  // namespace gem::cpu
