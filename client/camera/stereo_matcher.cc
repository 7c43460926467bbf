#include "client/camera/stereo_matcher.h"

#include <algorithm>
#include <cstdlib>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>
#include <utility>

#include "absl/strings/str_cat.h"
#include "core/base/status_macros.h"

namespace gem {
namespace {

constexpr int kSpeckleBand_px = 32;
constexpr int kSteps = 16;  // a disparity of StereoSGBM is a multiple of 1/16 pixel
static_assert(cv::StereoMatcher::DISP_SCALE == kSteps);

/// Brightness (ITU-R BT.601); grey stays what it is.
cv::Mat GreyOf(const Image& image) {
  cv::Mat grey(image.height, image.width, CV_8UC1);
  for (std::int32_t v = 0; v < image.height; ++v) {
    std::uint8_t* row = grey.ptr<std::uint8_t>(v);
    for (std::int32_t u = 0; u < image.width; ++u) {
      const Rgb p = image.At(u, v);
      row[u] = static_cast<std::uint8_t>((299 * p.red + 587 * p.green + 114 * p.blue + 500) / 1000);
    }
  }
  return grey;
}

}  // namespace

absl::Status Validate(const StereoMatcherOptions& options) {
  if (options.num_disparities < 16 || options.num_disparities > 1024 ||
      options.num_disparities % 16 != 0)
    return absl::InvalidArgumentError(absl::StrCat("stereo.num_disparities is ",
                                                   options.num_disparities,
                                                   ", want a multiple of 16 in [16, 1024]"));
  if (options.block_px < 1 || options.block_px > 21 || options.block_px % 2 == 0)
    return absl::InvalidArgumentError(
        absl::StrCat("stereo.block_px is ", options.block_px, ", want an odd number in [1, 21]"));
  if (!(options.left_right_px_max >= 0 && options.left_right_px_max <= 16))
    return absl::InvalidArgumentError(
        absl::StrCat("stereo.left_right_px_max is ", options.left_right_px_max, ", want [0, 16]"));
  if (options.speckle_area_px < 0 || options.speckle_area_px > 1'000'000)
    return absl::InvalidArgumentError(
        absl::StrCat("stereo.speckle_area_px is ", options.speckle_area_px, ", want [0, 1e6]"));
  if (!(options.speckle_side_baselines >= 0 && options.speckle_side_baselines <= 10))
    return absl::InvalidArgumentError(absl::StrCat(
        "stereo.speckle_side_baselines is ", options.speckle_side_baselines, ", want [0, 10]"));
  return absl::OkStatus();
}

struct StereoMatcher::Impl {
  explicit Impl(const StereoMatcherOptions& wanted) : options(wanted) {
    const int area = options.block_px * options.block_px;
    sgbm = cv::StereoSGBM::create(
        /*minDisparity=*/0, options.num_disparities, options.block_px, /*P1=*/8 * area,
        /*P2=*/32 * area, /*disp12MaxDiff=*/-1, /*preFilterCap=*/63, /*uniquenessRatio=*/10,
        /*speckleWindowSize=*/0, /*speckleRange=*/0, cv::StereoSGBM::MODE_SGBM);
  }

  /// Disparities in 1/16 pixel of the left image of a pair; negative: none. StereoSGBM gives none
  /// within num_disparities of the left border, hence the room beside it.
  cv::Mat Disparity(const cv::Mat& left, const cv::Mat& right) const {
    const int room = options.num_disparities;
    cv::Mat wide_left, wide_right, wide;
    cv::copyMakeBorder(left, wide_left, 0, 0, room, 0, cv::BORDER_REPLICATE);
    cv::copyMakeBorder(right, wide_right, 0, 0, room, 0, cv::BORDER_REPLICATE);
    sgbm->compute(wide_left, wide_right, wide);
    return wide.colRange(room, wide.cols).clone();
  }

  void Match(const Image& left, const Image& right, DisparityImage& disparity) const {
    const cv::Mat left_grey = GreyOf(left), right_grey = GreyOf(right);
    cv::Mat from_left = Disparity(left_grey, right_grey);
    // In a mirror the right camera is the left one.
    cv::Mat left_mirrored, right_mirrored, from_right;
    cv::flip(left_grey, left_mirrored, 1);
    cv::flip(right_grey, right_mirrored, 1);
    cv::flip(Disparity(right_mirrored, left_mirrored), from_right, 1);
    KeepConsistent(from_right, from_left);
    RemoveSpeckles(from_left);
    for (std::int32_t v = 0; v < left.height; ++v) {
      const std::int16_t* row = from_left.ptr<std::int16_t>(v);
      float* out = disparity.disparity_px.data() + static_cast<std::size_t>(v) * left.width;
      for (std::int32_t u = 0; u < left.width; ++u)
        out[u] = row[u] > 0 ? static_cast<float>(row[u]) / kSteps : 0.0f;
    }
  }

  void KeepConsistent(const cv::Mat& from_right, cv::Mat& from_left) const {
    const int disparity_end = (options.num_disparities - 1) * kSteps;
    const auto difference_max = static_cast<int>(options.left_right_px_max * kSteps);
    for (int v = 0; v < from_left.rows; ++v) {
      std::int16_t* row = from_left.ptr<std::int16_t>(v);
      const std::int16_t* right_row = from_right.ptr<std::int16_t>(v);
      for (int u = 0; u < from_left.cols; ++u) {
        const int u_right = (u * kSteps - row[u] + kSteps / 2) / kSteps;
        // At the end of the search the best one may lie beyond.
        const bool agrees = row[u] > 0 && row[u] < disparity_end && u * kSteps >= row[u] &&
                            right_row[u_right] > 0 &&
                            std::abs(right_row[u_right] - row[u]) <= difference_max;
        if (!agrees) row[u] = 0;
      }
    }
  }

  /// Takes patches away that are too small for how near they would be.
  void RemoveSpeckles(cv::Mat& disparity) const {
    for (int nearer_px = 0; nearer_px < options.num_disparities; nearer_px += kSpeckleBand_px) {
      cv::Mat near = disparity.clone();
      near.setTo(0, disparity < nearer_px * kSteps);
      cv::Mat kept = near.clone();
      const float side_px = options.speckle_side_baselines * static_cast<float>(nearer_px);
      cv::filterSpeckles(
          kept, 0, std::max(options.speckle_area_px, static_cast<int>(side_px * side_px)), kSteps);
      disparity.setTo(0, kept != near);
    }
  }

  const StereoMatcherOptions options;
  cv::Ptr<cv::StereoSGBM> sgbm;
};

StereoMatcher::StereoMatcher(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
StereoMatcher::~StereoMatcher() = default;

absl::StatusOr<std::unique_ptr<StereoMatcher>> StereoMatcher::Make(
    const StereoMatcherOptions& options) {
  GEM_RETURN_IF_ERROR(Validate(options));
  return std::unique_ptr<StereoMatcher>(new StereoMatcher(std::make_unique<Impl>(options)));
}

absl::Status StereoMatcher::Match(const Image& left, const Image& right,
                                  DisparityImage& disparity) {
  if (left.width <= 0 || left.height <= 0 || left.width != right.width ||
      left.height != right.height)
    return absl::InvalidArgumentError(absl::StrCat(
        "the left image has ", left.width, " x ", left.height, " pixels, the right one ",
        right.width, " x ", right.height, ", want the same and at least one"));
  disparity.width = left.width;
  disparity.height = left.height;
  disparity.disparity_px.resize(static_cast<std::size_t>(left.width) * left.height);
  try {
    impl_->Match(left, right, disparity);
  } catch (const cv::Exception& error) {
    // Out of memory at the latest; nobody beyond this line knows exceptions.
    return absl::InternalError(absl::StrCat("OpenCV's stereo matching failed: ", error.what()));
  }
  return absl::OkStatus();
}

}  // namespace gem
