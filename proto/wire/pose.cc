#include "proto/wire/pose.h"

#include <cmath>

#include "absl/strings/str_cat.h"
#include "core/base/status_macros.h"
#include "core/grid/cell_index.h"
#include "gem/v1/ingest_service.pb.h"
#include "gem/v1/types.pb.h"
#include "proto/wire/refusal.h"
#include "proto/wire/scalar.h"

namespace gem::wire {
namespace {

constexpr double kQuaternionNormTolerance = 1e-2;

absl::Status CheckCoordinate(double value_m, const FieldPath& field) {
  GEM_RETURN_IF_ERROR(CheckFinite(value_m, field));
  if (std::abs(value_m) <= kCoordinateMax_m) return absl::OkStatus();
  return Refuse(field, value_m, absl::StrCat("at most ", kCoordinateMax_m, " in magnitude"));
}

}  // namespace

namespace internal {

absl::StatusOr<RawPose> RawFromProto(const v1::Transform& proto, const FieldPath& field) {
  GEM_RETURN_IF_ERROR(CheckCoordinate(proto.x(), field.Child("x")));
  GEM_RETURN_IF_ERROR(CheckCoordinate(proto.y(), field.Child("y")));
  GEM_RETURN_IF_ERROR(CheckCoordinate(proto.z(), field.Child("z")));
  GEM_RETURN_IF_ERROR(CheckFinite(proto.qx(), field.Child("qx")));
  GEM_RETURN_IF_ERROR(CheckFinite(proto.qy(), field.Child("qy")));
  GEM_RETURN_IF_ERROR(CheckFinite(proto.qz(), field.Child("qz")));
  GEM_RETURN_IF_ERROR(CheckFinite(proto.qw(), field.Child("qw")));
  const Eigen::Quaterniond rotation(proto.qw(), proto.qx(), proto.qy(), proto.qz());
  const double norm = rotation.norm();
  // "field is value" names the four fields at once: the quaternion has no field of its own.
  if (norm == 0)
    return Refuse(field, "a zero quaternion (qx = qy = qz = qw = 0)", "a norm within 0.01 of 1");
  if (!(std::abs(norm - 1) <= kQuaternionNormTolerance))
    return Refuse(field, absl::StrCat("a quaternion of norm ", norm), "a norm within 0.01 of 1");
  return RawPose{rotation.normalized(), {proto.x(), proto.y(), proto.z()}};
}

void RawToProto(const Eigen::Quaterniond& rotation, const Eigen::Vector3d& translation,
                v1::Transform* proto) {
  proto->set_x(translation.x());
  proto->set_y(translation.y());
  proto->set_z(translation.z());
  proto->set_qx(rotation.x());
  proto->set_qy(rotation.y());
  proto->set_qz(rotation.z());
  proto->set_qw(rotation.w());
}

}  // namespace internal

absl::StatusOr<std::vector<StampedPose<Odom, Base>>> FromProto(const v1::PoseBatch& proto,
                                                               const FieldPath& field) {
  const FieldPath poses_field = field.Child("poses");
  if (proto.poses_size() < 1 || proto.poses_size() > kPosesOfBatch_max)
    return Refuse(poses_field, absl::StrCat(proto.poses_size(), " poses"),
                  absl::StrCat("1 to ", kPosesOfBatch_max),
                  proto.poses_size() > kPosesOfBatch_max ? ProblemReason::kTooLarge
                                                         : ProblemReason::kMalformed);
  std::vector<StampedPose<Odom, Base>> poses;
  poses.reserve(static_cast<std::size_t>(proto.poses_size()));
  for (int i = 0; i < proto.poses_size(); ++i) {
    const v1::OdometryPose& pose = proto.poses(i);
    const FieldPath element = poses_field.At(static_cast<std::size_t>(i));
    const FieldPath stamp_field = element.Child("stamp_ns");
    GEM_RETURN_IF_ERROR(CheckStamp(pose.stamp_ns(), stamp_field));
    if (!poses.empty() && pose.stamp_ns() <= poses.back().stamp_ns)
      return Refuse(stamp_field, absl::StrCat(pose.stamp_ns()),
                    absl::StrCat("more than the stamp before it, ", poses.back().stamp_ns),
                    ProblemReason::kOutOfOrder);
    if (!pose.has_odom_from_base())
      return Refuse(element.Child("odom_from_base"), "unset", "a transform");
    auto T_O_B = FromProto<Odom, Base>(pose.odom_from_base(), element.Child("odom_from_base"));
    if (!T_O_B.ok()) return T_O_B.status();
    poses.push_back({pose.stamp_ns(), *T_O_B});
  }
  return poses;
}

void ToProto(const std::vector<StampedPose<Odom, Base>>& poses, v1::PoseBatch* proto) {
  proto->clear_poses();
  proto->mutable_poses()->Reserve(static_cast<int>(poses.size()));
  for (const StampedPose<Odom, Base>& pose : poses) {
    v1::OdometryPose* element = proto->add_poses();
    element->set_stamp_ns(pose.stamp_ns);
    ToProto(pose.T_A_B, element->mutable_odom_from_base());
  }
}

}  // namespace gem::wire
