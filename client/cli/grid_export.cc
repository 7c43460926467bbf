#include "client/cli/grid_export.h"

#include <algorithm>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/formats/esri_ascii.h"
#include "client/formats/png_file.h"
#include "client/pictures/map_picture.h"
#include "core/base/check.h"
#include "core/base/status_macros.h"

namespace gem::client {
namespace {

/// Every value of a layer as a number; colours fit a float exactly.
std::vector<float> Numbers(const GridLayer& layer) {
  if (layer.layer != Layer::kColor) return layer.values;
  std::vector<float> numbers;
  numbers.reserve(layer.colors.size());
  for (const Rgba rgba : layer.colors)
    numbers.push_back(
        static_cast<float>((rgba & 0xff) << 16 | (rgba & 0xff00) | (rgba >> 16 & 0xff)));
  return numbers;
}

std::string ToXyz(const PlacedGrid& map, const GridLayer& layer) {
  const std::vector<float> numbers = Numbers(layer);
  std::string text;
  std::size_t cell = 0;
  for (std::int32_t row = 0; row < map.grid.rows; ++row) {
    for (std::int32_t column = 0; column < map.grid.columns; ++column, ++cell) {
      if (layer.valid[cell] == 0) continue;
      // Twelve digits keep micrometres a thousand kilometres out; nine keep a float.
      absl::StrAppendFormat(&text, "%.12g %.12g %.9g\n",
                            CenterOf(map.origin.x + column, map.grid.cell_size_m),
                            CenterOf(map.origin.y + row, map.grid.cell_size_m), numbers[cell]);
    }
  }
  return text;
}

}  // namespace

absl::StatusOr<ExportFormat> ParseExportFormat(const std::string& name) {
  if (name == "asc") return ExportFormat::kEsriAscii;
  if (name == "xyz") return ExportFormat::kXyz;
  if (name == "png") return ExportFormat::kPng;
  return absl::InvalidArgumentError(absl::StrCat("format is \"", name, "\", want asc, xyz or png"));
}

std::vector<Layer> LayersToRead(Layer layer, ExportFormat format) {
  std::vector<Layer> layers = {Layer::kElevation};
  // An orthophoto is drawn from the colours alone.
  if (format == ExportFormat::kPng && layer != Layer::kColor)
    layers.push_back(Layer::kTraversability);
  if (std::find(layers.begin(), layers.end(), layer) == layers.end()) layers.push_back(layer);
  return layers;
}

absl::StatusOr<std::string> Export(const PlacedGrid& map, Layer layer, ExportFormat format) {
  const GridLayer* found = map.grid.Find(layer);
  GEM_CHECK(found != nullptr);
  switch (format) {
    case ExportFormat::kEsriAscii:
      return ToEsriAscii({map.grid.columns, map.grid.rows, map.origin.x * map.grid.cell_size_m,
                          map.origin.y * map.grid.cell_size_m, map.grid.cell_size_m,
                          Numbers(*found), found->valid});
    case ExportFormat::kXyz:
      return ToXyz(map, *found);
    case ExportFormat::kPng:
      break;
  }
  if (layer == Layer::kColor) return ToPng(DrawOrthophoto(map));
  PictureOptions options;
  options.layer = layer;
  return ToPng(Draw(map, options));
}

}  // namespace gem::client
