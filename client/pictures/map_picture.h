// Draws a map for people: a hillshade, coloured by what a robot can do there, or an orthophoto.
// North is up.
#pragma once

#include "absl/status/statusor.h"
#include "client/formats/png_file.h"
#include "client/placed_grid.h"

namespace gem::client {

struct PictureOptions {
  /// Elevation and traversability are drawn as a hillshade with colours for traversability: green
  /// is free, red to brown an obstacle, grey known but not annotated. Other layers run from dark
  /// blue over green to yellow between their 2nd and 98th percentile. Not the colour: see
  /// DrawOrthophoto().
  Layer layer = Layer::kTraversability;
  /// Edge of a cell, pixels; 0: so that the longer side has 512 to 4096 pixels where it can.
  std::int32_t pixels_per_cell = 0;
  /// Longer side of the picture, pixels; larger maps are drawn with several cells to a pixel, of
  /// which the least traversable is shown (orthophoto: their mean). Range [1, 16384].
  std::int32_t side_pixels_max = 4096;
};

/// What is not known. No other colour comes near it.
inline constexpr Rgb kUnknownColor{226, 232, 240};

/// `map` must have elevation, traversability and the layer to draw.
Image Draw(const PlacedGrid& map, const PictureOptions& options);

/// The map's colours as they are, seen from straight above: neither shaded nor stretched. What has
/// no colour is transparent. `map` must have the colour; of the options the layer is ignored. As
/// large as Draw() makes the same map, so that one lies on the other.
TransparentImage DrawOrthophoto(const PlacedGrid& map, const PictureOptions& options = {});

}  // namespace gem::client
