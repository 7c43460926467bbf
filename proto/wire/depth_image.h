// gem.v1.DepthImage <-> DepthImage. What is valid here, Unproject() turns into points that are
// finite and within 1e6 m.
#pragma once

#include <cstdint>
#include <string>

#include "absl/status/statusor.h"
#include "core/sensor/depth_image.h"
#include "proto/wire/field_path.h"

namespace gem::v1 {
class DepthImage;
}  // namespace gem::v1

namespace gem::wire {

struct ScanLimits;

/// The image, whose pixels stay in `proto`. An error names the field and carries a ProblemReason.
absl::StatusOr<DepthImage> FromProto(const v1::DepthImage& proto, const ScanLimits& limits,
                                     const FieldPath& field);

/// Pixels that were compressed.
struct InflatedPixels {
  std::string depth;
  std::string rgb;
};
/// The same of an image whose depth and rgb are one zstd frame each; its pixels lie in `pixels`.
absl::StatusOr<DepthImage> FromCompressedProto(const v1::DepthImage& proto,
                                               const ScanLimits& limits, const FieldPath& field,
                                               InflatedPixels& pixels);
/// Copies the pixels. Judges nothing: FromProto() does.
void ToProto(const DepthImage& image, v1::DepthImage* proto);

}  // namespace gem::wire
