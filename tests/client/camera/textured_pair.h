// A rectified pair of images of a textured wall that stands square before the camera.
#pragma once

#include <cstdint>
#include <random>

#include "client/formats/png_file.h"

namespace gem {

/// Grey noise; what is at column u of the left image is at u - disparity_px of the right one.
struct TexturedPair {
  Image left, right;
};
inline TexturedPair MakeTexturedPair(std::int32_t width, std::int32_t height,
                                     std::int32_t disparity_px) {
  std::mt19937 random(1);
  std::uniform_int_distribution<int> grey(0, 255);
  TexturedPair pair{{width, height, {}}, {width, height, {}}};
  for (std::int32_t v = 0; v < height; ++v) {
    std::vector<Rgb> wall;
    for (std::int32_t i = 0; i < width + disparity_px; ++i) {
      const auto value = static_cast<std::uint8_t>(grey(random));
      wall.push_back({value, value, value});
    }
    pair.left.pixels.insert(pair.left.pixels.end(), wall.begin(), wall.begin() + width);
    pair.right.pixels.insert(pair.right.pixels.end(), wall.begin() + disparity_px, wall.end());
  }
  return pair;
}

}  // namespace gem
