// gem.v1.Scan <-> points of the local mapper. Everything is validated before anything is allocated.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "core/geometry/pose.h"
#include "core/sensor/packed_points.h"
#include "core/sensor/scan_point.h"
#include "proto/wire/field_path.h"

namespace gem::v1 {
class Scan;
}  // namespace gem::v1

namespace gem::wire {

/// What one scan may hold.
struct ScanLimits {
  std::uint64_t scan_bytes_max = 16u << 20;
  std::uint32_t points_max = 2'000'000;
};

/// Numbers of gem.v1.ScanCompression.
enum class ScanCompression : std::uint8_t { kNone = 1, kZstd = 2, kDeltaZstd = 3 };

/// Covariance of a pose, split as the mappers need it.
struct PoseCovariance {
  Eigen::Matrix3d translation_m2 = Eigen::Matrix3d::Zero();  ///< in O
  Eigen::Matrix3d rotation_rad2 = Eigen::Matrix3d::Zero();   ///< of the rotation vector, in B
};

/// What becomes of points that are int16.
enum class PointForm : std::uint8_t {
  kDecoded,
  kPacked,  ///< they stay as they are where none can be out of range: see DecodedScan::packed
};

/// A scan as it came over the wire. The caller keeps one and reuses its buffer.
struct DecodedScan {
  std::uint64_t seq = 0;
  std::int64_t stamp_ns = 0;
  std::string sensor;
  std::optional<Pose<Odom, Base>> T_O_B;
  std::optional<PoseCovariance> covariance;
  std::vector<ScanPoint> points;
  /// Instead of points, if it is not empty. Views the message that it came in, or `inflated`.
  PackedPoints packed;
  /// Points that came compressed. On the heap, so that views of it survive when the scan is moved.
  std::unique_ptr<const std::string> inflated;
  /// When each point was measured, relative to the stamp: at most kTimeOffsetMax_s in magnitude.
  /// Empty: all at the stamp.
  std::vector<float> time_offsets_s;
};

/// What the robot's credit pays for: bytes of points, or of depths and colours, as they are sent.
std::uint64_t PayloadBytes(const v1::Scan& proto);

/// Fills `scan` and reuses its buffers; a depth image is unprojected. What is compressed is
/// inflated only if it will fit the limits, and only to the size that the scan's other fields say.
/// On an error, which names the field and carries a ProblemReason, `scan` is unspecified. Points
/// are finite and within 1e6 m.
absl::Status FromProto(const v1::Scan& proto, const ScanLimits& limits, const FieldPath& field,
                       DecodedScan& scan, PointForm form = PointForm::kDecoded);

/// x, y, z as FLOAT32 and, if any point has a colour, rgba. Sets points, fields, count, stride
/// and that they are not compressed. time_offsets_s: one for each point, or none.
void PointsToProto(std::span<const ScanPoint> points, v1::Scan* proto,
                   std::span<const float> time_offsets_s = {});
/// x, y, z as INT16 of the given scale: half of the bytes; the rest as above. INVALID_ARGUMENT for
/// a point that does not fit.
absl::Status PointsToProtoInt16(std::span<const ScanPoint> points, double scale_m, v1::Scan* proto,
                                std::span<const float> time_offsets_s = {});

/// Compresses the points or pixels of a complete scan that is not compressed yet. kDeltaZstd is for
/// points: a depth image gets kZstd instead.
void Compress(ScanCompression compression, v1::Scan* proto);

/// 21 values of the upper triangle by rows; the cross terms of rotation and translation are zero.
void CovarianceToProto(const PoseCovariance& covariance, v1::Scan* proto);

}  // namespace gem::wire
