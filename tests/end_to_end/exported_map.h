// An exported map as a table from cell to value, and how two of them differ.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <vector>

namespace gem::test {

/// Cell (floor(x / cell_size), floor(y / cell_size)) to the third column.
using ExportedMap = std::map<std::pair<std::int64_t, std::int64_t>, double>;

/// Reads `x y z` lines. Aborts on anything else: the test wrote the file through `gem`.
ExportedMap ReadXyz(const std::string& file, double cell_size_m);

struct Difference {
  std::size_t num_cells = 0;  ///< cells that both have and that are wanted
  double median = 0;          ///< of |a - b|
  double p95 = 0;
  double max = 0;
};

/// Over the cells whose traversability is above `free` in both.
Difference Compare(const ExportedMap& a, const ExportedMap& a_traversability, const ExportedMap& b,
                   const ExportedMap& b_traversability, double free = 0.7);

}  // namespace gem::test
