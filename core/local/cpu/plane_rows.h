// Annotates the cells around changed ones, row by row. The plane fits of a row share the sums over
// their columns, and run side by side in the lanes of the vectors.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "core/base/vector_set.h"
#include "core/local/annotate.h"
#include "core/local/cpu/layers.h"
#include "core/local/ring_window.h"

namespace gem::cpu {

/// Buffers of one thread.
class PlaneRows {
 public:
  explicit PlaneRows(std::int32_t side_cells);

  /// Annotates the known cells of rows [row_begin, row_end) that lie in the neighbourhood of a
  /// changed cell. changed: 0 or 1 by window index. Heights are fitted relative to reference_m.
  void Annotate(VectorSet set, const RingWindow& window, float reference_m,
                const LocalMapOptions& options, std::span<const std::uint8_t> changed,
                std::int32_t row_begin, std::int32_t row_end, Layers& layers);

 private:
  static constexpr std::int32_t kRows = 2 * kPlaneRadius_cells + 1;
  // Cells are handled so many at a time, the last ones of a run along with what lies behind them:
  // left to a loop without vectors, they would take a third of the time.
  static constexpr std::int32_t kLanes = 16;

  // A row of the window with a margin, so that neighbourhoods need not ask where it ends; cells
  // outside are unknown. Index: column + kPlaneRadius_cells. Unknown cells follow, for whole lanes.
  struct Row {
    std::int32_t row = -1;            // of the window; -1: none
    std::vector<double> height_m;     // relative to the reference; 0 if unknown
    std::vector<std::int32_t> known;  // 0 or 1
  };

  bool FindDirty(std::span<const std::uint8_t> changed, std::int32_t row);
  const Row& RowAt(std::int32_t row);
  void AnnotateRow(std::int32_t row);
  // Of num_lanes groups of kLanes cells, from column `begin` on.
  void SumColumns(std::int32_t row, std::int32_t begin, std::int32_t num_lanes);
  void FitCells(std::int32_t begin, std::int32_t num_lanes);
  void JudgeCells(std::int32_t begin, std::int32_t num_lanes);
  void Store(std::int32_t row, std::int32_t begin, std::int32_t end);
  void StoreRun(std::int32_t row, std::int32_t begin, std::int32_t end);

  // Constant after construction.
  const std::int32_t side_cells_;

  // Of the call in hand.
  const RingWindow* window_ = nullptr;
  const LocalMapOptions* options_ = nullptr;
  Layers* layers_ = nullptr;
  float reference_m_ = 0;

  std::array<Row, kRows> rows_;  // row r is in rows_[r % kRows]
  Row outside_;
  std::vector<std::uint8_t> near_rows_;  // with margin: a change in the column, at most 2 rows away
  std::vector<std::uint8_t> dirty_;      // by column

  // Of the row in hand: sums by column, with margin.
  std::vector<std::int32_t> count_, y_, yy_;
  std::vector<double> z_, yz_, zz_;
  // Of the row in hand, by column: plane fits, and annotations.
  std::vector<std::int32_t> num_cells_, valid_, stored_;
  std::vector<float> rise_x_m_, rise_y_m_, squares_m2_;
  std::vector<float> slope_rad_, roughness_m_, traversability_;
};

}  // namespace gem::cpu
