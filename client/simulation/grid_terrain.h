// Ground from a raster of heights, bilinear between the middles of its cells. Rays are cast
// exactly: patch by patch along the ray, with a quadratic equation in each.
#pragma once

#include <optional>

#include "client/formats/esri_ascii.h"
#include "client/simulation/height_field.h"

namespace gem {

class GridTerrain final : public HeightField {
 public:
  /// At least 2 x 2 cells.
  explicit GridTerrain(EsriAsciiGrid grid);

  /// Nothing outside the grid and in patches of which a corner has no height.
  std::optional<double> HeightAt(double x_m, double y_m) const override;
  std::optional<double> Cast(const Ray& ray, double range_m_max) const override;

  /// The heights' extent: the middles of the outermost cells.
  double x_m_min() const { return grid_.x_m_min + 0.5 * grid_.cell_size_m; }
  double y_m_min() const { return grid_.y_m_min + 0.5 * grid_.cell_size_m; }
  double x_m_max() const { return x_m_min() + (grid_.columns - 1) * grid_.cell_size_m; }
  double y_m_max() const { return y_m_min() + (grid_.rows - 1) * grid_.cell_size_m; }

 private:
  /// z = a + b u + c v + d u v with u, v in [0, 1] from the patch's lower left height.
  struct Patch {
    double a = 0, b = 0, c = 0, d = 0;
    double z_m_max = 0;
  };
  std::optional<Patch> PatchAt(int column, int row) const;
  std::optional<double> CastPatch(const Ray& ray, int column, int row, double begin_m,
                                  double end_m) const;

  // Constant after construction.
  EsriAsciiGrid grid_;
};

}  // namespace gem
