// Disparity of a rectified stereo pair: OpenCV's semi-global matching, run from both images and
// kept where they agree. Knows nothing of metres.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/formats/png_file.h"

namespace gem {

struct StereoMatcherOptions {
  /// Disparities that are looked for: 0 to this, pixels. What is nearer than focal length times
  /// baseline over this is not found; time grows with it. A multiple of 16 in [16, 1024].
  std::int32_t num_disparities = 128;
  /// Edge of the window that is compared, pixels: larger is smoother, and blurs edges. Odd, [1,
  /// 21].
  std::int32_t block_px = 5;
  /// The disparities that the left and the right image find for one point differ by no more,
  /// pixels. Occluded places, the sky and bare walls fail this. Range [0, 16].
  float left_right_px_max = 1.0f;
  /// Smaller patches of smooth disparity are noise, pixels of area. Range [0, 1e6].
  std::int32_t speckle_area_px = 200;
  /// Patches that would be narrower than so many baselines (a baseline is as wide as the disparity)
  /// are noise too: bland sky that happens to match near by. Range [0, 10].
  float speckle_side_baselines = 0.4f;
};

/// INVALID_ARGUMENT: "stereo.block_px is 4, want an odd number in [1, 21]".
absl::Status Validate(const StereoMatcherOptions& options);

/// By rows from the top left. A point at column u of the left image is at u - disparity of the
/// right.
struct DisparityImage {
  std::int32_t width = 0;
  std::int32_t height = 0;
  std::vector<float> disparity_px;  ///< in steps of 1/16; 0 where none was found

  float At(std::int32_t u, std::int32_t v) const {
    return disparity_px[static_cast<std::size_t>(v) * static_cast<std::size_t>(width) +
                        static_cast<std::size_t>(u)];
  }
};

/// Not thread-safe; one thread at a time.
class StereoMatcher {
 public:
  static absl::StatusOr<std::unique_ptr<StereoMatcher>> Make(const StereoMatcherOptions& options);
  ~StereoMatcher();

  /// Disparities of the left image. INVALID_ARGUMENT if the images are empty or differ in size.
  absl::Status Match(const Image& left, const Image& right, DisparityImage& disparity);

 private:
  struct Impl;  // OpenCV's headers stay in one file: they are slow to compile
  explicit StereoMatcher(std::unique_ptr<Impl> impl);
  const std::unique_ptr<Impl> impl_;
};

}  // namespace gem
