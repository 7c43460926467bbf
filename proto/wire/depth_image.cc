#include "proto/wire/depth_image.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <string>

#include "absl/strings/str_cat.h"
#include "core/base/status_macros.h"
#include "gem/v1/types.pb.h"
#include "proto/wire/refusal.h"
#include "proto/wire/scalar.h"
#include "proto/wire/scan.h"
#include "proto/wire/zstd_frame.h"

namespace gem::wire {
namespace {

static_assert(std::endian::native == std::endian::little, "depths are read as they lie");

constexpr std::uint32_t kSidePixels_max = 16384;
constexpr std::uint32_t kStep_max = 64;
constexpr std::uint64_t kColorBytes = 3;  ///< of a pixel
constexpr double kScaleMax_m = 1;
constexpr double kUsualScale_m = 0.001;
constexpr double kPrincipalPointMax_px = 1e6;
constexpr double kFocalLengthMax_px = 1e6;
/// x and y of a point are at most so many times its depth: 1e6 m at 1000 m.
constexpr double kRaySlopeMax = 1000;

absl::Status CheckSide(std::uint32_t pixels, const FieldPath& field) {
  if (pixels >= 1 && pixels <= kSidePixels_max) return absl::OkStatus();
  return Refuse(field, absl::StrCat(pixels), absl::StrCat("1 to ", kSidePixels_max),
                pixels == 0 ? ProblemReason::kMalformed : ProblemReason::kTooLarge);
}

/// One axis of the camera: `pixels` along it.
absl::Status CheckCamera(double focal_px, double center_px, std::uint32_t pixels,
                         const FieldPath& focal_field, const FieldPath& center_field) {
  if (!(std::abs(center_px) <= kPrincipalPointMax_px))  // NaN, too
    return Refuse(center_field, center_px,
                  absl::StrCat("at most ", kPrincipalPointMax_px, " in magnitude"));
  const double widest_px = std::max(std::abs(center_px), std::abs(pixels - 1 - center_px));
  // A picture of one pixel on the axis still needs a focal length.
  const double focal_px_min = std::max(widest_px / kRaySlopeMax, 1e-3);
  if (focal_px >= focal_px_min && focal_px <= kFocalLengthMax_px) return absl::OkStatus();
  return Refuse(focal_field, focal_px, absl::StrCat(focal_px_min, " to ", kFocalLengthMax_px));
}

absl::Status CheckBytes(std::uint64_t bytes, std::uint64_t bytes_a_pixel,
                        const v1::DepthImage& proto, const FieldPath& field) {
  const std::uint64_t wanted = std::uint64_t{proto.width()} * proto.height() * bytes_a_pixel;
  if (bytes == wanted) return absl::OkStatus();
  return Refuse(field, absl::StrCat(bytes, " bytes"),
                absl::StrCat("width * height * ", bytes_a_pixel, " = ", proto.width(), " * ",
                             proto.height(), " * ", bytes_a_pixel, " = ", wanted));
}

absl::StatusOr<float> UnitFromProto(const v1::DepthImage& proto, const FieldPath& field) {
  const double scale_m = proto.scale();
  if (proto.encoding() == v1::DepthImage::ENCODING_UINT16) {
    if (scale_m == 0) return static_cast<float>(kUsualScale_m);
    if (scale_m > 0 && scale_m <= kScaleMax_m) return static_cast<float>(scale_m);
    return Refuse(field, scale_m, absl::StrCat("0 (means 0.001) to ", kScaleMax_m));
  }
  if (scale_m == 0) return 1.0f;
  return Refuse(field, scale_m, "0 for ENCODING_FLOAT32");
}

absl::StatusOr<DepthEncoding> EncodingFromProto(const v1::DepthImage& proto,
                                                const FieldPath& field) {
  switch (proto.encoding()) {
    case v1::DepthImage::ENCODING_UINT16:
      return DepthEncoding::kUint16;
    case v1::DepthImage::ENCODING_FLOAT32:
      return DepthEncoding::kFloat32;
    default:
      return Refuse(field, absl::StrCat(static_cast<int>(proto.encoding())),
                    "ENCODING_UINT16 or ENCODING_FLOAT32");
  }
}

std::span<const std::byte> BytesOf(const std::string& bytes) {
  return std::as_bytes(std::span(bytes.data(), bytes.size()));
}

absl::Status CheckTotal(std::uint64_t bytes, const ScanLimits& limits, const FieldPath& field) {
  if (bytes <= limits.scan_bytes_max) return absl::OkStatus();
  return Refuse(field, absl::StrCat(bytes, " bytes with rgb"),
                absl::StrCat("at most ", limits.scan_bytes_max), ProblemReason::kTooLarge);
}

std::uint64_t DepthBytesOf(DepthEncoding encoding) {
  return encoding == DepthEncoding::kUint16 ? 2 : 4;
}

/// Everything but the pixels.
absl::StatusOr<DepthImage> CameraFromProto(const v1::DepthImage& proto, const FieldPath& field) {
  DepthImage image;
  GEM_RETURN_IF_ERROR(CheckSide(proto.width(), field.Child("width")));
  GEM_RETURN_IF_ERROR(CheckSide(proto.height(), field.Child("height")));
  GEM_RETURN_IF_ERROR(
      CheckCamera(proto.fx(), proto.cx(), proto.width(), field.Child("fx"), field.Child("cx")));
  GEM_RETURN_IF_ERROR(
      CheckCamera(proto.fy(), proto.cy(), proto.height(), field.Child("fy"), field.Child("cy")));
  GEM_ASSIGN_OR_RETURN(image.encoding, EncodingFromProto(proto, field.Child("encoding")));
  GEM_ASSIGN_OR_RETURN(image.unit_m, UnitFromProto(proto, field.Child("scale")));
  if (proto.step() > kStep_max)
    return Refuse(field.Child("step"), absl::StrCat(proto.step()),
                  absl::StrCat("0 (means 1) to ", kStep_max));
  image.width = proto.width();
  image.height = proto.height();
  image.fx_px = proto.fx();
  image.fy_px = proto.fy();
  image.cx_px = proto.cx();
  image.cy_px = proto.cy();
  image.step = std::max(1u, proto.step());
  return image;
}

absl::Status CheckSampled(const DepthImage& image, const ScanLimits& limits,
                          const FieldPath& field) {
  if (NumSampledPixels(image) <= limits.points_max) return absl::OkStatus();
  return Refuse(field, absl::StrCat("an image of ", NumSampledPixels(image), " sampled pixels"),
                absl::StrCat("at most ", limits.points_max), ProblemReason::kTooLarge);
}

}  // namespace

absl::StatusOr<DepthImage> FromProto(const v1::DepthImage& proto, const ScanLimits& limits,
                                     const FieldPath& field) {
  const FieldPath depth_field = field.Child("depth");
  GEM_RETURN_IF_ERROR(
      CheckTotal(std::uint64_t{proto.depth().size()} + proto.rgb().size(), limits, depth_field));
  GEM_ASSIGN_OR_RETURN(DepthImage image, CameraFromProto(proto, field));
  GEM_RETURN_IF_ERROR(
      CheckBytes(proto.depth().size(), DepthBytesOf(image.encoding), proto, depth_field));
  if (!proto.rgb().empty())
    GEM_RETURN_IF_ERROR(CheckBytes(proto.rgb().size(), kColorBytes, proto, field.Child("rgb")));
  GEM_RETURN_IF_ERROR(CheckSampled(image, limits, field));
  image.depth = BytesOf(proto.depth());
  image.rgb = BytesOf(proto.rgb());
  return image;
}

absl::StatusOr<DepthImage> FromCompressedProto(const v1::DepthImage& proto,
                                               const ScanLimits& limits, const FieldPath& field,
                                               InflatedPixels& pixels) {
  const FieldPath depth_field = field.Child("depth");
  GEM_ASSIGN_OR_RETURN(DepthImage image, CameraFromProto(proto, field));
  const std::uint64_t num_pixels = std::uint64_t{image.width} * image.height;
  const std::uint64_t depth_bytes = num_pixels * DepthBytesOf(image.encoding);
  const std::uint64_t rgb_bytes = proto.rgb().empty() ? 0 : num_pixels * kColorBytes;
  GEM_RETURN_IF_ERROR(CheckTotal(depth_bytes + rgb_bytes, limits, depth_field));
  GEM_RETURN_IF_ERROR(CheckSampled(image, limits, field));
  GEM_ASSIGN_OR_RETURN(pixels.depth, Inflated(proto.depth(), depth_bytes, depth_field));
  pixels.rgb.clear();
  if (rgb_bytes != 0) {
    GEM_ASSIGN_OR_RETURN(pixels.rgb, Inflated(proto.rgb(), rgb_bytes, field.Child("rgb")));
  }
  image.depth = BytesOf(pixels.depth);
  image.rgb = BytesOf(pixels.rgb);
  return image;
}

void ToProto(const DepthImage& image, v1::DepthImage* proto) {
  proto->set_width(image.width);
  proto->set_height(image.height);
  proto->set_fx(image.fx_px);
  proto->set_fy(image.fy_px);
  proto->set_cx(image.cx_px);
  proto->set_cy(image.cy_px);
  const bool is_uint16 = image.encoding == DepthEncoding::kUint16;
  proto->set_encoding(is_uint16 ? v1::DepthImage::ENCODING_UINT16
                                : v1::DepthImage::ENCODING_FLOAT32);
  proto->set_scale(is_uint16 ? double{image.unit_m} : 0);
  proto->set_step(image.step);
  proto->set_depth(image.depth.data(), image.depth.size());
  proto->set_rgb(image.rgb.data(), image.rgb.size());
}

}  // namespace gem::wire
