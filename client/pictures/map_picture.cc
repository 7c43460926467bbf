#include "client/pictures/map_picture.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <optional>
#include <vector>

#include "core/base/check.h"

namespace gem::client {
namespace {

constexpr std::int32_t kSidePixelsWanted = 512;
constexpr std::int32_t kPixelsPerCellMax = 16;

struct Color {
  float red = 0, green = 0, blue = 0;
};

Color Mix(Color a, Color b, float fraction) {
  return {a.red + fraction * (b.red - a.red), a.green + fraction * (b.green - a.green),
          a.blue + fraction * (b.blue - a.blue)};
}

constexpr Color kObstacle{150, 40, 30};
constexpr Color kNearlyFree{205, 125, 60};
constexpr Color kBarelyFree{190, 200, 90};
constexpr Color kFree{85, 170, 85};
constexpr Color kNotAnnotated{150, 150, 150};

Color TraversabilityColor(float traversability, float free) {
  if (traversability > free)
    return Mix(kBarelyFree, kFree, std::min(1.0f, (traversability - free) / (1 - free)));
  return Mix(kObstacle, kNearlyFree, std::max(0.0f, traversability / free));
}

/// Dark blue over green to yellow; fraction in [0, 1].
Color RampColor(float fraction) {
  constexpr std::array<Color, 4> kStops = {Color{60, 40, 110}, Color{45, 115, 140},
                                           Color{75, 175, 110}, Color{240, 225, 60}};
  const float place = std::clamp(fraction, 0.0f, 1.0f) * (kStops.size() - 1);
  const auto stop = std::min(static_cast<std::size_t>(place), kStops.size() - 2);
  return Mix(kStops[stop], kStops[stop + 1], place - static_cast<float>(stop));
}

/// The 2nd and 98th percentile of the known values: a single wild cell does not darken the rest.
struct Range {
  float low = 0, high = 0;
};
Range RangeOf(const GridLayer& layer) {
  std::vector<float> values;
  for (std::size_t i = 0; i < layer.values.size(); ++i)
    if (layer.valid[i] != 0) values.push_back(layer.values[i]);
  if (values.empty()) return {};
  const auto at = [&values](double fraction) {
    const auto place = values.begin() + static_cast<std::ptrdiff_t>(
                                            fraction * static_cast<double>(values.size() - 1));
    std::nth_element(values.begin(), place, values.end());
    return *place;
  };
  return {at(0.02), at(0.98)};
}

class Painter {
 public:
  Painter(const PlacedGrid& map, Layer layer)
      : grid_(map.grid),
        free_(map.traversability_free),
        elevation_(*map.grid.Find(Layer::kElevation)),
        traversability_(*map.grid.Find(Layer::kTraversability)),
        layer_(*map.grid.Find(layer)) {
    range_ = RangeOf(layer_);
  }

  Rgb ColorOf(std::int32_t column, std::int32_t row) const {
    const std::size_t cell = IndexOf(column, row);
    if (elevation_.valid[cell] == 0) return kUnknownColor;
    const Color color = FlatColorOf(cell);
    const float shade = ShadeOf(column, row);
    const auto byte = [shade](float value) {
      return static_cast<std::uint8_t>(std::lround(std::clamp(value * shade, 0.0f, 255.0f)));
    };
    return {byte(color.red), byte(color.green), byte(color.blue)};
  }

  /// Which of several cells a pixel shows: an obstacle before anything else, unknown last.
  float RankOf(std::int32_t column, std::int32_t row) const {
    const std::size_t cell = IndexOf(column, row);
    if (elevation_.valid[cell] == 0) return 3;
    return traversability_.valid[cell] == 0 ? 2 : traversability_.values[cell];
  }

 private:
  std::size_t IndexOf(std::int32_t column, std::int32_t row) const {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(grid_.columns) +
           static_cast<std::size_t>(column);
  }

  Color FlatColorOf(std::size_t cell) const {
    switch (layer_.layer) {
      case Layer::kElevation:
      case Layer::kTraversability:
        return traversability_.valid[cell] == 0
                   ? kNotAnnotated
                   : TraversabilityColor(traversability_.values[cell], free_);
      default:
        if (layer_.valid[cell] == 0) return kNotAnnotated;
        return RampColor(range_.high > range_.low
                             ? (layer_.values[cell] - range_.low) / (range_.high - range_.low)
                             : 0.0f);
    }
  }

  std::optional<float> ElevationAt(std::int32_t column, std::int32_t row) const {
    if (column < 0 || row < 0 || column >= grid_.columns || row >= grid_.rows) return std::nullopt;
    const std::size_t cell = IndexOf(column, row);
    if (elevation_.valid[cell] == 0) return std::nullopt;
    return elevation_.values[cell];
  }

  /// Rise per metre from the neighbours that are known.
  float SlopeAlong(std::int32_t column, std::int32_t row, std::int32_t dx, std::int32_t dy) const {
    const float here = *ElevationAt(column, row);
    const std::optional<float> before = ElevationAt(column - dx, row - dy);
    const std::optional<float> after = ElevationAt(column + dx, row + dy);
    const float cells =
        static_cast<float>(before.has_value()) + static_cast<float>(after.has_value());
    if (cells == 0) return 0;
    return (after.value_or(here) - before.value_or(here)) /
           (cells * static_cast<float>(grid_.cell_size_m));
  }

  /// 1 on flat ground, more towards the light in the north-west at 45 degrees, less away from it.
  float ShadeOf(std::int32_t column, std::int32_t row) const {
    const float slope_x = SlopeAlong(column, row, 1, 0);
    const float slope_y = SlopeAlong(column, row, 0, 1);
    constexpr float kLightX = -0.5f, kLightY = 0.5f, kLightZ = 0.70710678f;
    const float cosine = (-slope_x * kLightX - slope_y * kLightY + kLightZ) /
                         std::sqrt(1 + slope_x * slope_x + slope_y * slope_y);
    return 0.4f + 0.6f * std::max(0.0f, cosine) / kLightZ;
  }

  const LayeredGrid& grid_;
  const float free_;
  const GridLayer& elevation_;
  const GridLayer& traversability_;
  const GridLayer& layer_;
  Range range_;
};

/// Edge of a cell in pixels, or how many cells go to a pixel: one of them is 1.
struct Scale {
  std::int32_t pixels_per_cell = 1;
  std::int32_t cells_per_pixel = 1;
};

Scale ScaleOf(const LayeredGrid& grid, const PictureOptions& options) {
  const std::int32_t side_cells = std::max(grid.columns, grid.rows);
  const std::int32_t side_max = options.side_pixels_max;
  if (side_cells > side_max) return {1, (side_cells + side_max - 1) / side_max};
  const std::int32_t wanted =
      options.pixels_per_cell > 0
          ? options.pixels_per_cell
          : std::clamp((kSidePixelsWanted + side_cells - 1) / side_cells, 1, kPixelsPerCellMax);
  return {std::clamp(wanted, 1, std::max(1, side_max / side_cells)), 1};
}

/// The cells that a pixel shows.
struct PixelCells {
  std::int32_t column_begin, column_end, row_begin, row_end;
};
struct PictureSize {
  std::int32_t width = 0, height = 0;
};
PictureSize SizeOf(const LayeredGrid& grid, const Scale& scale) {
  const auto pixels_of = [&scale](std::int32_t cells) {
    return (cells + scale.cells_per_pixel - 1) / scale.cells_per_pixel * scale.pixels_per_cell;
  };
  return {pixels_of(grid.columns), pixels_of(grid.rows)};
}
/// Calls `visit` with the cells of each pixel, from the top left by rows. The top row of the
/// picture is the northernmost of the map.
template <typename Visitor>
void VisitPixels(const LayeredGrid& grid, const Scale& scale, Visitor visit) {
  const PictureSize size = SizeOf(grid, scale);
  for (std::int32_t y = 0; y < size.height; ++y) {
    const std::int32_t row = (size.height - 1 - y) / scale.pixels_per_cell * scale.cells_per_pixel;
    for (std::int32_t x = 0; x < size.width; ++x) {
      const std::int32_t column = x / scale.pixels_per_cell * scale.cells_per_pixel;
      visit(PixelCells{column, std::min(column + scale.cells_per_pixel, grid.columns), row,
                       std::min(row + scale.cells_per_pixel, grid.rows)});
    }
  }
}

/// Mean of the cells that have a colour; 0 if none has.
Rgba MeanColor(const LayeredGrid& grid, const GridLayer& layer, const PixelCells& cells) {
  std::uint32_t sums[3] = {};
  std::uint32_t num_colored = 0;
  for (std::int32_t row = cells.row_begin; row < cells.row_end; ++row) {
    for (std::int32_t column = cells.column_begin; column < cells.column_end; ++column) {
      const std::size_t cell =
          static_cast<std::size_t>(row) * static_cast<std::size_t>(grid.columns) +
          static_cast<std::size_t>(column);
      if (layer.valid[cell] == 0) continue;
      ++num_colored;
      for (int channel = 0; channel < 3; ++channel)
        sums[channel] += layer.colors[cell] >> (8 * channel) & 0xff;
    }
  }
  if (num_colored == 0) return 0;
  Rgba mean = 0xff000000u;
  for (int channel = 0; channel < 3; ++channel)
    mean |= (sums[channel] + num_colored / 2) / num_colored << (8 * channel);
  return mean;
}

}  // namespace

Image Draw(const PlacedGrid& map, const PictureOptions& options) {
  GEM_CHECK(options.layer != Layer::kColor);
  GEM_CHECK(map.grid.Find(Layer::kElevation) != nullptr);
  GEM_CHECK(map.grid.Find(Layer::kTraversability) != nullptr);
  GEM_CHECK(map.grid.Find(options.layer) != nullptr);
  const Scale scale = ScaleOf(map.grid, options);
  const Painter painter(map, options.layer);
  const PictureSize size = SizeOf(map.grid, scale);
  Image image{size.width, size.height, {}};
  image.pixels.reserve(static_cast<std::size_t>(size.width) * size.height);
  VisitPixels(map.grid, scale, [&](const PixelCells& cells) {
    std::int32_t shown_column = cells.column_begin, shown_row = cells.row_begin;
    for (std::int32_t row = cells.row_begin; row < cells.row_end; ++row)
      for (std::int32_t column = cells.column_begin; column < cells.column_end; ++column)
        if (painter.RankOf(column, row) < painter.RankOf(shown_column, shown_row))
          shown_column = column, shown_row = row;
    image.pixels.push_back(painter.ColorOf(shown_column, shown_row));
  });
  return image;
}

TransparentImage DrawOrthophoto(const PlacedGrid& map, const PictureOptions& options) {
  const GridLayer* color = map.grid.Find(Layer::kColor);
  GEM_CHECK(color != nullptr);
  const Scale scale = ScaleOf(map.grid, options);
  const PictureSize size = SizeOf(map.grid, scale);
  TransparentImage image{size.width, size.height, {}};
  image.pixels.reserve(static_cast<std::size_t>(size.width) * size.height);
  VisitPixels(map.grid, scale, [&](const PixelCells& cells) {
    image.pixels.push_back(MeanColor(map.grid, *color, cells));
  });
  return image;
}

}  // namespace gem::client
