// Colours the points of a scan from a camera's image. A pure function: who recorded the image, and
// when, is the caller's business.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "client/camera/camera_model.h"
#include "client/formats/png_file.h"
#include "core/geometry/pose.h"
#include "core/grid/cell_belief.h"
#include "core/sensor/scan.h"

namespace gem {

/// Opaque.
inline Rgba RgbaOf(Rgb pixel) {
  return Rgba{pixel.red} | Rgba{pixel.green} << 8 | Rgba{pixel.blue} << 16 | Rgba{255} << 24;
}

/// What hides what. The image is cut into blocks; a point takes a colour only if it lies no deeper
/// than the nearest point of its block and a margin. Blocks must be wider than the gaps between
/// the points, or the background shows through; with wider blocks a wider rim of the background
/// beside an edge stays without colour.
struct ColorProjectionOptions {
  /// Edge of a block, pixels. 8 spans the gaps of 64 rings on images of 700 pixels focal length.
  /// Range [1, 1024].
  std::int32_t block_px = 8;
  /// Margin: this, and
  double margin_m = 0.3;
  /// so much for each metre of depth: flat ground seen at a grazing angle spans some depth within a
  /// block.
  double margin_per_m = 0.1;
};

/// Gives the points that the camera sees the colour of the nearest pixel, and returns how many.
/// Points behind the camera, outside of the image or hidden keep what they have: 0, no colour,
/// leaves the colour of a cell as it is. O(points + blocks of the image).
std::size_t ProjectColors(std::span<ScanPoint> points, const Image& image,
                          const CameraModel& camera, const Pose<Camera, Sensor>& T_C_S,
                          const ColorProjectionOptions& options = {});

}  // namespace gem
