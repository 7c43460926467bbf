// gem.v1.Transform <-> Pose<A, B>, and trajectories of them.
#pragma once

#include <cstdint>
#include <vector>

#include "absl/status/statusor.h"
#include "core/geometry/pose.h"
#include "core/geometry/trajectory.h"
#include "proto/wire/field_path.h"

namespace gem::v1 {
class PoseBatch;
class Transform;
}  // namespace gem::v1

namespace gem::wire {

inline constexpr int kPosesOfBatch_max = 4096;

namespace internal {
struct RawPose {
  Eigen::Quaterniond rotation;
  Eigen::Vector3d translation;
};
absl::StatusOr<RawPose> RawFromProto(const v1::Transform& proto, const FieldPath& field);
void RawToProto(const Eigen::Quaterniond& rotation, const Eigen::Vector3d& translation,
                v1::Transform* proto);
}  // namespace internal

/// Refuses what is not finite, translations beyond 1e6 m and quaternions whose norm is not within
/// 1e-2 of 1 (all zero included); normalises the others.
template <typename A, typename B>
absl::StatusOr<Pose<A, B>> FromProto(const v1::Transform& proto, const FieldPath& field) {
  absl::StatusOr<internal::RawPose> raw = internal::RawFromProto(proto, field);
  if (!raw.ok()) return raw.status();
  return Pose<A, B>(raw->rotation, raw->translation);
}

template <typename A, typename B>
void ToProto(const Pose<A, B>& T_A_B, v1::Transform* proto) {
  internal::RawToProto(T_A_B.rotation(), T_A_B.translation(), proto);
}

/// At most kPosesOfBatch_max poses, stamps increase strictly within the batch.
absl::StatusOr<std::vector<StampedPose<Odom, Base>>> FromProto(const v1::PoseBatch& proto,
                                                               const FieldPath& field);
void ToProto(const std::vector<StampedPose<Odom, Base>>& poses, v1::PoseBatch* proto);

}  // namespace gem::wire
