#include "client/camera/stereo_matcher.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "tests/client/camera/textured_pair.h"

namespace gem {
namespace {

using ::testing::HasSubstr;

constexpr std::int32_t kWidth = 320, kHeight = 60;

DisparityImage Match(const Image& left, const Image& right) {
  DisparityImage disparity;
  const absl::Status status = StereoMatcher::Make({}).value()->Match(left, right, disparity);
  EXPECT_TRUE(status.ok()) << status;
  return disparity;
}

TEST(StereoMatcher, FindsHowFarAWallIsShifted) {
  const TexturedPair pair = MakeTexturedPair(kWidth, kHeight, 20);
  const DisparityImage found = Match(pair.left, pair.right);
  ASSERT_EQ(found.disparity_px.size(), static_cast<std::size_t>(kWidth * kHeight));
  int num_right = 0, num_wrong = 0;
  for (std::int32_t v = 0; v < kHeight; ++v) {
    for (std::int32_t u = 0; u < kWidth; ++u) {
      const float disparity_px = found.At(u, v);
      if (disparity_px == 0) continue;
      ++(std::abs(disparity_px - 20) <= 0.25f ? num_right : num_wrong);
    }
  }
  EXPECT_GT(num_right, 0.95 * (kWidth - 20) * kHeight);
  EXPECT_LT(num_wrong, 0.01 * kWidth * kHeight);
}

TEST(StereoMatcher, FindsThingsUpToTheBordersThatBothImagesSee) {
  // Plain StereoSGBM answers nothing left of column 128.
  const TexturedPair pair = MakeTexturedPair(kWidth, kHeight, 20);
  const DisparityImage found = Match(pair.left, pair.right);
  for (const std::int32_t u : {26, 60, 120, kWidth - 3})
    EXPECT_NEAR(found.At(u, kHeight / 2), 20, 0.25) << "column " << u;
}

TEST(StereoMatcher, SaysNothingOfWhatOneImageSees) {
  const TexturedPair pair = MakeTexturedPair(kWidth, kHeight, 20);
  const DisparityImage found = Match(pair.left, pair.right);
  // The first 20 columns are left of what the right camera sees.
  for (std::int32_t u = 0; u < 16; ++u) EXPECT_EQ(found.At(u, kHeight / 2), 0) << "column " << u;
}

TEST(StereoMatcher, SaysNothingOfImagesThatHaveNothingInCommon) {
  const TexturedPair pair = MakeTexturedPair(kWidth, kHeight, 20);
  Image other = pair.right;
  std::shuffle(other.pixels.begin(), other.pixels.end(), std::mt19937(2));
  const DisparityImage found = Match(pair.left, other);
  const auto num_found =
      kWidth * kHeight - std::count(found.disparity_px.begin(), found.disparity_px.end(), 0.0f);
  EXPECT_LT(num_found, 0.02 * kWidth * kHeight);
}

TEST(StereoMatcher, SaysNothingOfABareWall) {
  const Image bare{kWidth, kHeight, std::vector<Rgb>(kWidth * kHeight, {90, 90, 90})};
  const DisparityImage found = Match(bare, bare);
  EXPECT_EQ(std::count(found.disparity_px.begin(), found.disparity_px.end(), 0.0f),
            kWidth * kHeight);
}

TEST(StereoMatcher, RefusesImagesOfTwoSizes) {
  DisparityImage disparity;
  EXPECT_THAT(std::string(StereoMatcher::Make({})
                              .value()
                              ->Match(MakeTexturedPair(32, 8, 0).left,
                                      MakeTexturedPair(32, 9, 0).left, disparity)
                              .message()),
              HasSubstr("32 x 8 pixels, the right one 32 x 9"));
}

TEST(StereoMatcher, NamesTheOptionItDoesNotTake) {
  const auto error = [](StereoMatcherOptions options) {
    return std::string(StereoMatcher::Make(options).status().message());
  };
  EXPECT_THAT(error({.num_disparities = 100}), HasSubstr("stereo.num_disparities is 100"));
  EXPECT_THAT(error({.block_px = 4}), HasSubstr("stereo.block_px is 4"));
  EXPECT_THAT(error({.left_right_px_max = std::numeric_limits<float>::quiet_NaN()}),
              HasSubstr("stereo.left_right_px_max is nan"));
  EXPECT_THAT(error({.speckle_area_px = -1}), HasSubstr("stereo.speckle_area_px is -1"));
  EXPECT_THAT(error({.speckle_side_baselines = -1}),
              HasSubstr("stereo.speckle_side_baselines is -1"));
}

}  // namespace
}  // namespace gem
