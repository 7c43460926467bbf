#include "client/ingest_messages.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "absl/strings/str_cat.h"
#include "core/base/status_macros.h"
#include "core/sensor/deskew.h"
#include "gem/v1/ingest_service.pb.h"
#include "proto/wire/depth_image.h"
#include "proto/wire/pose.h"
#include "proto/wire/refusal.h"
#include "proto/wire/scan.h"
#include "proto/wire/session_setup.h"

namespace gem::client {
namespace {

constexpr double kInt16Max = 32767;

/// The largest magnitude of any coordinate; an error names the first point that is not finite.
absl::StatusOr<double> Extent_m(std::span<const ScanPoint> points) {
  float extent_m = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const ScanPoint& p = points[i];
    if (!std::isfinite(p.x_m) || !std::isfinite(p.y_m) || !std::isfinite(p.z_m))
      return absl::InvalidArgumentError(absl::StrCat("points[", i, "] is (", p.x_m, ", ", p.y_m,
                                                     ", ", p.z_m, "), want finite coordinates"));
    extent_m = std::max({extent_m, std::abs(p.x_m), std::abs(p.y_m), std::abs(p.z_m)});
  }
  return extent_m;
}

absl::Status CheckTimeOffsets(const OutgoingScan& scan) {
  const std::span<const float> offsets_s = scan.time_offsets_s;
  if (!offsets_s.empty() && offsets_s.size() != scan.points.size())
    return absl::InvalidArgumentError(absl::StrCat("time_offsets_s has ", offsets_s.size(),
                                                   " values, want none or one for each of ",
                                                   scan.points.size(), " points"));
  for (std::size_t i = 0; i < offsets_s.size(); ++i)
    if (!(std::abs(offsets_s[i]) <= kTimeOffsetMax_s))  // NaN, too
      return absl::InvalidArgumentError(absl::StrCat("time_offsets_s[", i, "] is ", offsets_s[i],
                                                     ", want at most ", kTimeOffsetMax_s,
                                                     " in magnitude"));
  return absl::OkStatus();
}

absl::Status DepthImageToProto(const OutgoingScan& scan, v1::Scan* proto) {
  if (!scan.points.empty() || !scan.time_offsets_s.empty())
    return absl::InvalidArgumentError("the scan has points and a depth image, want one of the two");
  wire::ToProto(*scan.depth_image, proto->mutable_depth_image());
  // How much it may be is the server's to say.
  const wire::ScanLimits no_limits = {std::numeric_limits<std::uint64_t>::max(),
                                      std::numeric_limits<std::uint32_t>::max()};
  return wire::FromProto(proto->depth_image(), no_limits, wire::FieldPath("depth_image")).status();
}

}  // namespace

void ToProto(const SessionSetup& setup, v1::OpenSession* proto) {
  wire::SessionSetup wire;
  wire.map = setup.map;
  wire.robot = setup.robot;
  wire.session = setup.session;
  wire.T_G_O = setup.T_G_O;
  for (const SensorSetup& sensor : setup.sensors)
    wire.sensors.push_back({sensor.name, sensor.T_B_S, sensor.noise});
  wire.local_map.side_m = setup.side_m;
  wire.local_map.range_m_min = setup.range_m_min;
  wire.local_map.range_m_max = setup.range_m_max;
  wire.local_map.height_m_min = setup.height_m_min;
  wire.local_map.height_m_max = setup.height_m_max;
  if (setup.body) {
    const Eigen::Vector3f& min = setup.body->min;
    const Eigen::Vector3f& max = setup.body->max;
    wire.local_map.body = {min.x(), min.y(), min.z(), max.x(), max.y(), max.z()};
  }
  wire.map_setup.cell_size_m = setup.cell_size_m;
  wire.map_setup.submap_length_m = setup.submap_length_m;
  wire.map_setup.traversable_only = setup.traversable_only;
  wire::ToProto(wire, proto);
}

absl::Status ToProto(const OutgoingScan& scan, const IngestOptions& options, v1::Scan* proto) {
  proto->set_stamp_ns(scan.stamp_ns);
  proto->set_sensor(scan.sensor);
  if (scan.T_O_B) wire::ToProto(*scan.T_O_B, proto->mutable_odom_from_base());
  if (scan.covariance)
    wire::CovarianceToProto({scan.covariance->translation_m2, scan.covariance->rotation_rad2},
                            proto);
  if (scan.depth_image) return DepthImageToProto(scan, proto);
  GEM_ASSIGN_OR_RETURN(const double extent_m, Extent_m(scan.points));
  GEM_RETURN_IF_ERROR(CheckTimeOffsets(scan));
  if (options.point_encoding == PointEncoding::kFloat32) {
    wire::PointsToProto(scan.points, proto, scan.time_offsets_s);
    return absl::OkStatus();
  }
  // One far point coarsens the whole scan, but never makes it fail.
  return wire::PointsToProtoInt16(scan.points, std::max(options.int16_step_m, extent_m / kInt16Max),
                                  proto, scan.time_offsets_s);
}

void Compress(ScanCompression compression, v1::Scan* proto) {
  switch (compression) {
    case ScanCompression::kNone:
      return;
    case ScanCompression::kZstd:
      return wire::Compress(wire::ScanCompression::kZstd, proto);
    case ScanCompression::kDeltaZstd:
      return wire::Compress(wire::ScanCompression::kDeltaZstd, proto);
  }
}

IngestProblem FromProto(const v1::ScanProblem& proto) {
  return {proto.seq(), std::string(wire::NameOf(static_cast<wire::ProblemReason>(proto.reason()))),
          proto.message()};
}

}  // namespace gem::client
