// Writes a map as a file that other programs read: ESRI ASCII, x y z text, PNG.
#pragma once

#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/placed_grid.h"

namespace gem::client {

enum class ExportFormat {
  kEsriAscii,  ///< "asc": north row first, -9999 where nothing is known
  kXyz,        ///< "xyz": one line `x y z` a known cell, cell centres, from the south-west by rows
  kPng,        ///< "png": see map_picture.h
};

/// "asc", "xyz" or "png".
absl::StatusOr<ExportFormat> ParseExportFormat(const std::string& name);

/// What must be read of a map to export one layer of it. Elevation is always there, because it
/// decides the extent.
std::vector<Layer> LayersToRead(Layer layer, ExportFormat format);

/// The file's contents. A colour becomes the number red * 65536 + green * 256 + blue.
absl::StatusOr<std::string> Export(const PlacedGrid& map, Layer layer, ExportFormat format);

}  // namespace gem::client
