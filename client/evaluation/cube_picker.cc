#include "client/evaluation/cube_picker.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>

namespace gem::evaluation {
namespace {

/// The value below which `share` of the values lie; zero of none.
double QuantileOf(std::vector<double> values, double share) {
  if (values.empty()) return 0;
  const auto last = static_cast<double>(values.size() - 1);
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(std::lround(share * last));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

enum class Kind : std::uint8_t { kUnknown, kLow, kHigh };

/// The cells of a map by what they may be.
class HighAndLow {
 public:
  HighAndLow(const LocalMap& map, double height_m_min)
      : map_(map), kinds_(map.num_cells(), Kind::kUnknown) {
    std::vector<double> heights_m;
    for (std::size_t i = 0; i < map.num_cells(); ++i)
      if (Known(i)) heights_m.push_back(map.elevation_m[i]);
    // Most of the map is ground, so its median is ground, too.
    const double high_m = QuantileOf(std::move(heights_m), 0.5) + height_m_min;
    for (std::size_t i = 0; i < map.num_cells(); ++i)
      if (Known(i)) kinds_[i] = map.elevation_m[i] > high_m ? Kind::kHigh : Kind::kLow;
  }

  double cell_size_m() const { return static_cast<double>(map_.cell_size_m); }
  double HeightAt(CellIndex cell) const {
    return static_cast<double>(map_.elevation_m[map_.IndexOf(cell)]);
  }
  Kind At(CellIndex cell) const {
    return map_.rect().Contains(cell) ? kinds_[map_.IndexOf(cell)] : Kind::kUnknown;
  }

  /// The group of high cells that holds `seed`; they are unknown from here on.
  std::vector<CellIndex> TakeGroup(CellIndex seed) {
    std::vector<CellIndex> group = {seed};
    kinds_[map_.IndexOf(seed)] = Kind::kUnknown;
    for (std::size_t next = 0; next < group.size(); ++next) {
      const CellIndex at = group[next];
      for (std::int32_t dy = -1; dy <= 1; ++dy) {
        for (std::int32_t dx = -1; dx <= 1; ++dx) {
          const CellIndex near{at.x + dx, at.y + dy};
          if (At(near) != Kind::kHigh) continue;
          kinds_[map_.IndexOf(near)] = Kind::kUnknown;
          group.push_back(near);
        }
      }
    }
    return group;
  }

 private:
  bool Known(std::size_t index) const { return (map_.state[index] & kCellKnown) != 0; }

  const LocalMap& map_;
  std::vector<Kind> kinds_;
};

/// Median of the low cells in the square about the place.
double GroundAbout(const HighAndLow& map, const Eigen::Vector2d& place_m, double reach_m) {
  const CellIndex low = CellAt(place_m.x() - reach_m, place_m.y() - reach_m, map.cell_size_m());
  const CellIndex high = CellAt(place_m.x() + reach_m, place_m.y() + reach_m, map.cell_size_m());
  std::vector<double> heights_m;
  for (std::int32_t y = low.y; y <= high.y; ++y)
    for (std::int32_t x = low.x; x <= high.x; ++x)
      if (map.At({x, y}) == Kind::kLow) heights_m.push_back(map.HeightAt({x, y}));
  return QuantileOf(std::move(heights_m), 0.5);
}

PickedCube Pick(const HighAndLow& map, std::vector<CellIndex> group) {
  PickedCube cube;
  std::vector<double> tops_m;
  for (const CellIndex cell : group) {
    cube.place_m +=
        Eigen::Vector2d(CenterOf(cell.x, map.cell_size_m()), CenterOf(cell.y, map.cell_size_m()));
    tops_m.push_back(map.HeightAt(cell));
  }
  cube.place_m /= static_cast<double>(group.size());
  // Wide enough that cells at the cube's foot, which hold points of its sides, are few.
  constexpr double kReach_m = 1.5;
  const double ground_m = GroundAbout(map, cube.place_m, kReach_m);
  cube.height_m = QuantileOf(tops_m, 0.75) - ground_m;
  cube.median_height_m = QuantileOf(std::move(tops_m), 0.5) - ground_m;
  cube.cells = std::move(group);
  return cube;
}

}  // namespace

std::vector<PickedCube> PickCubes(const LocalMap& map, double height_m_min) {
  HighAndLow cells(map, height_m_min);
  std::vector<PickedCube> cubes;
  const CellRect rect = map.rect();
  for (std::int32_t y = rect.min.y; y < rect.max.y; ++y)
    for (std::int32_t x = rect.min.x; x < rect.max.x; ++x)
      if (cells.At({x, y}) == Kind::kHigh) cubes.push_back(Pick(cells, cells.TakeGroup({x, y})));
  return cubes;
}

}  // namespace gem::evaluation
