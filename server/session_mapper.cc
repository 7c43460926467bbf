#include "server/session_mapper.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "proto/wire/pose.h"
#include "proto/wire/refusal.h"

namespace gem {
namespace {

/// Streamed poses that are kept to look scans up in: 100 s of odometry at 1 kHz.
constexpr std::size_t kStreamedPosesMax = 100'000;

using wire::FieldPath;
using wire::ProblemReason;

}  // namespace

SessionMapper::SessionMapper(const SessionConfig& config)
    : config_(config), builder_(config.setup.session, config.setup.robot, config.map) {
  absl::StatusOr<std::unique_ptr<LocalMapper>> mapper =
      MakeLocalMapper(config_.backend, config_.local_map);
  GEM_CHECK(mapper.ok());  // the options were validated when the session was opened
  mapper_ = *std::move(mapper);
}

absl::Status SessionMapper::AddPoses(const v1::PoseBatch& batch) {
  const FieldPath field("poses");
  auto poses = wire::FromProto(batch, field);
  if (!poses.ok()) return poses.status();
  if (!streamed_.empty() && poses->back().stamp_ns <= streamed_.back().stamp_ns) {
    const FieldPath list = field.Child("poses");
    const FieldPath last = list.At(poses->size() - 1);
    return wire::Refuse(last.Child("stamp_ns"), absl::StrCat(poses->back().stamp_ns),
                        absl::StrCat("more than the newest pose's, ", streamed_.back().stamp_ns),
                        ProblemReason::kOutOfOrder);
  }
  for (const StampedPose<Odom, Base>& pose : *poses)
    if (streamed_.empty() || pose.stamp_ns > streamed_.back().stamp_ns)
      streamed_.Append(pose.stamp_ns, pose.T_A_B);
  // Twice the limit first: dropping moves all others, so it must be rare.
  if (streamed_.size() > 2 * kStreamedPosesMax) streamed_.DropOldest(kStreamedPosesMax);
  return absl::OkStatus();
}

absl::Status SessionMapper::CheckOrder(std::uint64_t seq) const {
  if (seq == last_seq_ + 1) return absl::OkStatus();
  const FieldPath scan("scan");
  return wire::Refuse(scan.Child("seq"), absl::StrCat(seq),
                      absl::StrCat(last_seq_ + 1, ", the one after the last"),
                      ProblemReason::kOutOfOrder);
}

absl::StatusOr<SessionMapper::Intake> SessionMapper::Take(const v1::Scan& proto,
                                                          std::uint64_t seq) {
  // A resumed stream repeats what it does not know to have arrived.
  if (seq != 0 && seq <= last_seq_) return Intake::kDuplicate;
  GEM_RETURN_IF_ERROR(CheckOrder(seq));
  last_seq_ = seq;
  const FieldPath field("scan");
  GEM_RETURN_IF_ERROR(wire::FromProto(proto, config_.scan_limits, field, scan_));
  if (last_stamp_ns_.has_value() && scan_.stamp_ns <= *last_stamp_ns_)
    return wire::Refuse(field.Child("stamp_ns"), absl::StrCat(scan_.stamp_ns),
                        absl::StrCat("more than the scan's before it, ", *last_stamp_ns_),
                        ProblemReason::kOutOfOrder);
  const auto sensor =
      std::find_if(config_.setup.sensors.begin(), config_.setup.sensors.end(),
                   [&](const wire::SensorSetup& s) { return s.name == scan_.sensor; });
  if (sensor == config_.setup.sensors.end())
    return wire::Refuse(field.Child("sensor"), absl::StrCat("\"", scan_.sensor, "\""),
                        "a sensor that the session declared", ProblemReason::kUnknownSensor);
  sensor_ = &*sensor;
  return Intake::kTaken;
}

SessionMapper::PoseSearch SessionMapper::FindPose() {
  std::optional<Pose<Odom, Base>> T_O_B = scan_.T_O_B;
  if (!T_O_B.has_value()) T_O_B = streamed_.At(scan_.stamp_ns);
  if (T_O_B.has_value()) {
    T_O_B_ = *T_O_B;
    return PoseSearch::kFound;
  }
  // A robot that streams poses will send the next one; one that never did will not begin now.
  const bool may_come = !streamed_.empty() && streamed_.back().stamp_ns < scan_.stamp_ns;
  return may_come ? PoseSearch::kMayCome : PoseSearch::kNone;
}

absl::Status SessionMapper::RefuseForPose() const {
  const FieldPath field("scan");
  const std::string around = streamed_.empty()
                                 ? "of which there are none"
                                 : absl::StrCat("which span ", streamed_.front().stamp_ns, " to ",
                                                streamed_.back().stamp_ns);
  return wire::Refuse(field.Child("odom_from_base"), "unset",
                      absl::StrCat("a transform, or streamed poses around the stamp ",
                                   scan_.stamp_ns, ", ", around),
                      ProblemReason::kNoPose);
}

ScanReport SessionMapper::Fuse() {
  const wire::PoseCovariance covariance = scan_.covariance.value_or(config_.default_covariance);
  Scan scan;
  scan.seq = scan_.seq;
  scan.stamp_ns = scan_.stamp_ns;
  scan.T_O_B = T_O_B_;
  scan.T_B_S = sensor_->T_B_S;
  scan.rotation_covariance_rad2 = covariance.rotation_rad2;
  scan.translation_covariance_m2 = covariance.translation_m2;
  scan.noise = sensor_->noise;
  scan.points = scan_.points;
  evicted_.clear();
  const ScanReport report = mapper_->FuseScan(scan, evicted_);

  AppendOdometry();
  std::shared_ptr<const Submap> finished = builder_.Add(
      scan.stamp_ns, T_O_B_, {covariance.rotation_rad2, covariance.translation_m2}, evicted_);
  if (finished != nullptr) update_.finished.push_back(std::move(finished));
  last_stamp_ns_ = scan.stamp_ns;
  fused_any_ = true;
  return report;
}

void SessionMapper::AppendOdometry() {
  const auto append = [&](std::int64_t stamp_ns, const Pose<Odom, Base>& T_O_B) {
    if (last_odometry_ns_.has_value() && stamp_ns <= *last_odometry_ns_) return;
    update_.odometry.push_back({stamp_ns, T_O_B});
    last_odometry_ns_ = stamp_ns;
  };
  // The poses on the way from the last scan to this one tell how the robot got here.
  if (last_odometry_ns_.has_value() && !streamed_.empty()) {
    const auto& poses = streamed_.poses();
    auto pose = std::upper_bound(
        poses.begin(), poses.end(), *last_odometry_ns_,
        [](std::int64_t t, const StampedPose<Odom, Base>& p) { return t < p.stamp_ns; });
    for (; pose != poses.end() && pose->stamp_ns < scan_.stamp_ns; ++pose)
      append(pose->stamp_ns, pose->T_A_B);
  }
  append(scan_.stamp_ns, T_O_B_);
}

std::shared_ptr<const LocalMap> SessionMapper::CopyLocalMap() const {
  auto map = std::make_shared<LocalMap>();
  mapper_->CopyTo(*map);
  return map;
}

SessionUpdate SessionMapper::TakeUpdate(std::shared_ptr<const LocalMap> local_map) {
  SessionUpdate update = std::exchange(update_, {});
  update.active = builder_.ActiveSnapshot();
  update.local_map = std::move(local_map);
  return update;
}

SessionUpdate SessionMapper::End() {
  SessionUpdate update = std::exchange(update_, {});
  evicted_.clear();
  if (fused_any_) {
    mapper_->EvictAll(evicted_);
    std::shared_ptr<const Submap> finished = builder_.Finish(evicted_);
    if (finished != nullptr) update.finished.push_back(std::move(finished));
  }
  update.ended = true;
  return update;
}

}  // namespace gem
