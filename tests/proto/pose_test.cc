#include "proto/wire/pose.h"

#include <cmath>
#include <limits>

#include "gem/v1/ingest_service.pb.h"
#include "gem/v1/types.pb.h"
#include "proto/wire/correction.h"
#include "tests/proto/refused.h"

namespace gem::wire {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

v1::Transform Identity() {
  v1::Transform transform;
  transform.set_qw(1);
  return transform;
}

absl::StatusOr<Pose<Odom, Base>> Decode(const v1::Transform& transform) {
  return FromProto<Odom, Base>(transform, FieldPath("pose"));
}

TEST(PoseFromProto, SurvivesTheRoundTrip) {
  const Pose<Odom, Base> T_O_B = Pose<Odom, Base>::FromYaw(0.5, {1, -2, 3});
  v1::Transform proto;
  ToProto(T_O_B, &proto);
  const auto back = Decode(proto);
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ(back->translation(), T_O_B.translation());
  EXPECT_LT(back->rotation().angularDistance(T_O_B.rotation()), 1e-12);
}

TEST(PoseFromProto, NormalisesAQuaternionThatIsAlmostOfUnitLength) {
  v1::Transform proto = Identity();
  proto.set_qw(1.009);
  const auto pose = Decode(proto);
  ASSERT_TRUE(pose.ok()) << pose.status();
  EXPECT_DOUBLE_EQ(pose->rotation().w(), 1.0);
}

TEST(PoseFromProto, RefusesAZeroQuaternionByName) {
  EXPECT_THAT(
      Decode(v1::Transform()),
      Refused("pose",
              "pose is a zero quaternion (qx = qy = qz = qw = 0), want a norm within 0.01 of 1"));
}

TEST(PoseFromProto, RefusesANormTooFarFromOne) {
  v1::Transform proto = Identity();
  proto.set_qw(1.02);
  EXPECT_THAT(Decode(proto),
              Refused("pose", "pose is a quaternion of norm 1.02, want a norm within 0.01 of 1"));
  proto.set_qw(1e200);
  EXPECT_EQ(FieldOf(Decode(proto).status()), "pose");
}

TEST(PoseFromProto, NamesEachFieldThatIsNotFinite) {
  const auto with = [](auto set, double value) {
    v1::Transform proto = Identity();
    (proto.*set)(value);
    return Decode(proto);
  };
  EXPECT_THAT(with(&v1::Transform::set_x, kNan),
              Refused("pose.x", "pose.x is nan, want a finite number"));
  EXPECT_THAT(with(&v1::Transform::set_y, kInfinity),
              Refused("pose.y", "pose.y is inf, want a finite number"));
  EXPECT_THAT(with(&v1::Transform::set_z, -kInfinity),
              Refused("pose.z", "pose.z is -inf, want a finite number"));
  EXPECT_THAT(with(&v1::Transform::set_qx, kNan),
              Refused("pose.qx", "pose.qx is nan, want a finite number"));
  EXPECT_THAT(with(&v1::Transform::set_qy, kNan),
              Refused("pose.qy", "pose.qy is nan, want a finite number"));
  EXPECT_THAT(with(&v1::Transform::set_qz, kNan),
              Refused("pose.qz", "pose.qz is nan, want a finite number"));
  EXPECT_THAT(with(&v1::Transform::set_qw, kNan),
              Refused("pose.qw", "pose.qw is nan, want a finite number"));
}

TEST(PoseFromProto, AcceptsAMillionMetresAndNotMore) {
  v1::Transform proto = Identity();
  proto.set_y(-1e6);
  EXPECT_TRUE(Decode(proto).ok());
  proto.set_y(-1000001);
  EXPECT_THAT(Decode(proto),
              Refused("pose.y", "pose.y is -1e+06, want at most 1e+06 in magnitude"));
}

v1::PoseBatch Batch(std::initializer_list<std::int64_t> stamps) {
  v1::PoseBatch batch;
  for (const std::int64_t stamp_ns : stamps) {
    v1::OdometryPose* pose = batch.add_poses();
    pose->set_stamp_ns(stamp_ns);
    *pose->mutable_odom_from_base() = Identity();
  }
  return batch;
}

TEST(PoseBatchFromProto, KeepsOrderAndStamps) {
  const auto poses = FromProto(Batch({3, 5}), FieldPath("poses"));
  ASSERT_TRUE(poses.ok()) << poses.status();
  ASSERT_EQ(poses->size(), 2u);
  EXPECT_EQ((*poses)[1].stamp_ns, 5);
}

TEST(PoseBatchFromProto, RefusesWhatDoesNotIncrease) {
  const auto poses = FromProto(Batch({3, 3}), FieldPath("poses"));
  EXPECT_THAT(poses,
              Refused("poses.poses[1].stamp_ns",
                      "poses.poses[1].stamp_ns is 3, want more than the stamp before it, 3"));
  EXPECT_EQ(ReasonOf(poses.status()), ProblemReason::kOutOfOrder);
}

TEST(PoseBatchFromProto, RefusesNoneAndMoreThanTheLimit) {
  EXPECT_THAT(FromProto(Batch({}), FieldPath("poses")),
              Refused("poses.poses", "poses.poses is 0 poses, want 1 to 4096"));
  v1::PoseBatch batch;
  for (int i = 0; i < 4097; ++i) batch.add_poses();
  const auto poses = FromProto(batch, FieldPath("poses"));
  EXPECT_THAT(poses, Refused("poses.poses", "poses.poses is 4097 poses, want 1 to 4096"));
  EXPECT_EQ(ReasonOf(poses.status()), ProblemReason::kTooLarge);
}

TEST(PoseBatchFromProto, RefusesAPoseWithoutTransform) {
  v1::PoseBatch batch = Batch({1, 2});
  batch.mutable_poses(1)->clear_odom_from_base();
  EXPECT_THAT(FromProto(batch, FieldPath("poses")),
              Refused("poses.poses[1].odom_from_base",
                      "poses.poses[1].odom_from_base is unset, want a transform"));
}

CorrectionRequest TwoPoses() {
  return {"site", "s1", "r1", {{10, {}}, {20, Pose<Global, Base>::FromTranslation(1, 2, 3)}}};
}

TEST(CorrectionFromProto, SurvivesTheRoundTrip) {
  v1::CorrectTrajectoryRequest proto;
  ToProto(TwoPoses(), &proto);
  const auto back = FromProto(proto);
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ(back->map, "site");
  EXPECT_EQ(back->session, "s1");
  EXPECT_EQ(back->request_id, "r1");
  ASSERT_EQ(back->poses.size(), 2u);
  EXPECT_EQ(back->poses[1].stamp_ns, 20);
  EXPECT_EQ(back->poses[1].T_A_B.translation(), Eigen::Vector3d(1, 2, 3));
}

TEST(CorrectionFromProto, RefusesByName) {
  v1::CorrectTrajectoryRequest proto;
  ToProto(TwoPoses(), &proto);
  proto.mutable_poses(1)->set_stamp_ns(10);
  EXPECT_THAT(FromProto(proto),
              Refused("poses[1].stamp_ns",
                      "poses[1].stamp_ns is 10, want more than the stamp before it, 10"));
  ToProto(TwoPoses(), &proto);
  proto.mutable_poses(0)->mutable_map_from_base()->set_x(kNan);
  EXPECT_THAT(FromProto(proto), Refused("poses[0].map_from_base.x",
                                        "poses[0].map_from_base.x is nan, want a finite number"));
  ToProto(TwoPoses(), &proto);
  proto.mutable_poses(0)->mutable_map_from_base()->set_qw(0);
  EXPECT_EQ(FieldOf(FromProto(proto).status()), "poses[0].map_from_base");
  ToProto(TwoPoses(), &proto);
  proto.mutable_poses(0)->clear_map_from_base();
  EXPECT_THAT(FromProto(proto), Refused("poses[0].map_from_base",
                                        "poses[0].map_from_base is unset, want a transform"));
  ToProto(TwoPoses(), &proto);
  proto.mutable_poses(0)->set_stamp_ns(-1);
  EXPECT_THAT(FromProto(proto), Refused("poses[0].stamp_ns",
                                        "poses[0].stamp_ns is -1, want 0 to 4000000000000000000"));
  ToProto(TwoPoses(), &proto);
  proto.clear_poses();
  EXPECT_THAT(FromProto(proto), Refused("poses", "poses is 0 poses, want 1 to 1000000"));
  ToProto(TwoPoses(), &proto);
  EXPECT_THAT(FromProto(proto, 1), Refused("poses", "poses is 2 poses, want 1 to 1"));
  proto.set_map("..");
  EXPECT_EQ(FieldOf(FromProto(proto).status()), "map");
}

}  // namespace
}  // namespace gem::wire
