#include "proto/wire/correction.h"

#include "absl/strings/str_cat.h"
#include "core/base/status_macros.h"
#include "gem/v1/ingest_service.pb.h"
#include "proto/wire/pose.h"
#include "proto/wire/refusal.h"
#include "proto/wire/scalar.h"

namespace gem::wire {

absl::StatusOr<CorrectionRequest> FromProto(const v1::CorrectTrajectoryRequest& proto,
                                            int poses_max) {
  const FieldPath root;
  GEM_RETURN_IF_ERROR(CheckId(proto.map(), root.Child("map")));
  GEM_RETURN_IF_ERROR(CheckId(proto.session(), root.Child("session")));
  GEM_RETURN_IF_ERROR(CheckRequestId(proto.request_id(), root.Child("request_id")));
  const FieldPath poses = root.Child("poses");
  if (proto.poses_size() < 1 || proto.poses_size() > poses_max)
    return Refuse(poses, absl::StrCat(proto.poses_size(), " poses"),
                  absl::StrCat("1 to ", poses_max));
  CorrectionRequest request{proto.map(), proto.session(), proto.request_id(), {}};
  request.poses.reserve(static_cast<std::size_t>(proto.poses_size()));
  for (int i = 0; i < proto.poses_size(); ++i) {
    const v1::GlobalPose& pose = proto.poses(i);
    const FieldPath element = poses.At(static_cast<std::size_t>(i));
    const FieldPath stamp_field = element.Child("stamp_ns");
    GEM_RETURN_IF_ERROR(CheckStamp(pose.stamp_ns(), stamp_field));
    if (!request.poses.empty() && pose.stamp_ns() <= request.poses.back().stamp_ns)
      return Refuse(stamp_field, absl::StrCat(pose.stamp_ns()),
                    absl::StrCat("more than the stamp before it, ", request.poses.back().stamp_ns),
                    ProblemReason::kOutOfOrder);
    if (!pose.has_map_from_base())
      return Refuse(element.Child("map_from_base"), "unset", "a transform");
    auto T_G_B = FromProto<Global, Base>(pose.map_from_base(), element.Child("map_from_base"));
    if (!T_G_B.ok()) return T_G_B.status();
    request.poses.push_back({pose.stamp_ns(), *T_G_B});
  }
  return request;
}

void ToProto(const CorrectionRequest& request, v1::CorrectTrajectoryRequest* proto) {
  proto->set_map(request.map);
  proto->set_session(request.session);
  proto->set_request_id(request.request_id);
  proto->clear_poses();
  proto->mutable_poses()->Reserve(static_cast<int>(request.poses.size()));
  for (const StampedPose<Global, Base>& pose : request.poses) {
    v1::GlobalPose* element = proto->add_poses();
    element->set_stamp_ns(pose.stamp_ns);
    ToProto(pose.T_A_B, element->mutable_map_from_base());
  }
}

}  // namespace gem::wire
