// The cells that a robot's footprint touches while it moves straight ahead from one place to
// another, without turning. Exact: between the two places nothing is left out. Geometry only; what
// is known of the cells is terrain_reader.h.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>

#include "core/grid/cell_index.h"
#include "core/grid/terrain.h"

namespace gem {

/// Unit vector of the x axis of B in the x-y plane of G.
struct Heading {
  double x = 1;
  double y = 0;
};

/// Cells of one row, both ends included.
struct CellRun {
  std::int32_t row = 0;
  std::int32_t first_column = 0;
  std::int32_t last_column = 0;

  std::size_t num_cells() const {
    return static_cast<std::size_t>(std::int64_t{last_column} - first_column + 1);
  }
};

/// A convex, closed set in the x-y plane of G.
class SweptFootprint {
 public:
  /// B moves from `from` to `to`, which are the same or lie one behind the other along the heading.
  SweptFootprint(const Footprint& footprint, const Place& from, const Place& to,
                 const Heading& heading);

  /// Calls visit(CellRun) for every row with cells of which the set holds a point, from the lowest,
  /// until it returns false. There is always one.
  template <typename Visitor>
  void ForEachRun(double cell_size_m, Visitor visit) const {
    const std::int32_t last_row = CellOf(y_m_max_, cell_size_m);
    for (std::int32_t row = CellOf(y_m_min_, cell_size_m); row <= last_row; ++row) {
      // Clamped, so that rounding leaves no row beside the set.
      const Span span = SpanBetween(std::clamp(row * cell_size_m, y_m_min_, y_m_max_),
                                    std::clamp((row + 1) * cell_size_m, y_m_min_, y_m_max_));
      if (!visit(CellRun{row, CellOf(span.min_m, cell_size_m), CellOf(span.max_m, cell_size_m)}))
        return;
    }
  }

 private:
  struct Span {
    double min_m;
    double max_m;
    void Add(double x_m) {
      min_m = x_m < min_m ? x_m : min_m;
      max_m = x_m > max_m ? x_m : max_m;
    }
  };

  void AddCorners(const Rectangle& rectangle, const Place& from, double way_m,
                  const Heading& heading);
  /// Extent along x of the part of the set with y in [low_m, high_m], which overlaps the set's.
  Span SpanBetween(double low_m, double high_m) const;

  // The set is the convex hull of these.
  std::array<Place, 4> corners_;  ///< of a rectangle, in order
  bool has_corners_ = false;
  std::array<Place, 2> centers_;  ///< of discs
  std::size_t num_discs_ = 0;
  double radius_m_ = 0;

  double y_m_min_ = 0;
  double y_m_max_ = 0;
};

}  // namespace gem
