#include "tests/end_to_end/exported_map.h"

#include <algorithm>
#include <cmath>
#include <fstream>

#include "core/base/check.h"

namespace gem::test {

ExportedMap ReadXyz(const std::string& file, double cell_size_m) {
  std::ifstream in(file);
  GEM_CHECK(in.good());
  ExportedMap cells;
  double x = 0, y = 0, z = 0;
  while (in >> x >> y >> z) {
    const auto cell = std::make_pair(static_cast<std::int64_t>(std::floor(x / cell_size_m)),
                                     static_cast<std::int64_t>(std::floor(y / cell_size_m)));
    GEM_CHECK(cells.emplace(cell, z).second);
  }
  GEM_CHECK(in.eof());
  return cells;
}

Difference Compare(const ExportedMap& a, const ExportedMap& a_traversability, const ExportedMap& b,
                   const ExportedMap& b_traversability, double free) {
  const auto is_free = [free](const ExportedMap& traversability,
                              const ExportedMap::key_type& cell) {
    const auto found = traversability.find(cell);
    return found != traversability.end() && found->second > free;
  };
  std::vector<double> differences;
  for (const auto& [cell, z] : a) {
    const auto other = b.find(cell);
    if (other == b.end() || !is_free(a_traversability, cell) || !is_free(b_traversability, cell))
      continue;
    differences.push_back(std::abs(z - other->second));
  }
  if (differences.empty()) return {};
  std::sort(differences.begin(), differences.end());
  const std::size_t n = differences.size();
  return {n, differences[n / 2], differences[n * 95 / 100], differences.back()};
}

}  // namespace gem::test
