// A pinhole camera: how a point of its frame falls on its image. Knows neither distortion (images
// are rectified) nor where the camera is mounted.
#pragma once

namespace gem {

/// Frame C of a camera: x right, y down, z along the optical axis. Never instantiated.
struct Camera;

/// u = fx x / z + cx, v = fy y / z + cy; the centre of the top left pixel is at (0, 0).
struct CameraModel {
  double fx_px = 0;  ///< positive
  double fy_px = 0;  ///< positive
  double cx_px = 0;
  double cy_px = 0;
  friend bool operator==(const CameraModel&, const CameraModel&) = default;
};

}  // namespace gem
