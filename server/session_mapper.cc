#include "server/session_mapper.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "proto/wire/pose.h"
#include "proto/wire/refusal.h"
#include "spdlog/spdlog.h"

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
      MakeLocalMapper(config_.backend, config_.local_map, config_.local_threads);
  if (!mapper.ok() && config_.backend == LocalBackend::kCuda) {
    spdlog::warn("session {}: local mapper on the cpu backend: {}", config_.setup.session,
                 std::string(mapper.status().message()));
    mapper = MakeLocalMapper(LocalBackend::kCpu, config_.local_map, config_.local_threads);
  }
  GEM_CHECK(mapper.ok());  // the options were validated when the session was opened
  mapper_ = *std::move(mapper);
}

absl::Status SessionMapper::AddPoses(const v1::PoseBatch& batch) {
  const FieldPath field("poses");
  auto poses = wire::FromProto(batch, field);
  if (!poses.ok()) return poses.status();
  const bool any_new = streamed_.empty() || poses->back().stamp_ns > streamed_.back().stamp_ns;
  for (std::size_t i = 0; i < poses->size() && !any_new; ++i) {
    if (Knows((*poses)[i].stamp_ns)) continue;
    const FieldPath list = field.Child("poses");
    const FieldPath pose = list.At(i);
    return wire::Refuse(pose.Child("stamp_ns"), absl::StrCat((*poses)[i].stamp_ns),
                        absl::StrCat("more than the newest pose's, ", streamed_.back().stamp_ns),
                        ProblemReason::kOutOfOrder);
  }
  for (const StampedPose<Odom, Base>& pose : *poses)
    if (streamed_.empty() || pose.stamp_ns > streamed_.back().stamp_ns)
      streamed_.Append(pose.stamp_ns, pose.T_A_B);
  // Twice the limit first: dropping moves all others, so it must be rare.
  if (streamed_.size() > 2 * kStreamedPosesMax) {
    streamed_.DropOldest(kStreamedPosesMax);
    streamed_dropped_ = true;
  }
  return absl::OkStatus();
}

bool SessionMapper::Knows(std::int64_t stamp_ns) const {
  const auto& poses = streamed_.poses();
  const auto found = std::lower_bound(
      poses.begin(), poses.end(), stamp_ns,
      [](const StampedPose<Odom, Base>& p, std::int64_t t) { return p.stamp_ns < t; });
  if (found == poses.begin() && stamp_ns != found->stamp_ns) return streamed_dropped_;
  return found != poses.end() && found->stamp_ns == stamp_ns;
}

absl::Status SessionMapper::Take(std::shared_ptr<const v1::Scan> proto, HeldScan& held) {
  mapper_->Expect();
  held.scan = std::move(spare_);
  const FieldPath field("scan");
  GEM_RETURN_IF_ERROR(
      wire::FromProto(*proto, config_.scan_limits, field, held.scan, wire::PointForm::kPacked));
  const bool is_viewed = held.scan.packed.count != 0 && held.scan.inflated == nullptr;
  if (is_viewed) held.message = std::move(proto);
  const auto sensor =
      std::find_if(config_.setup.sensors.begin(), config_.setup.sensors.end(),
                   [&](const wire::SensorSetup& s) { return s.name == held.scan.sensor; });
  if (sensor == config_.setup.sensors.end())
    return wire::Refuse(field.Child("sensor"), absl::StrCat("\"", held.scan.sensor, "\""),
                        "a sensor that the session declared", ProblemReason::kUnknownSensor);
  held.sensor = &*sensor;
  held.span = SpanOf(held.scan.stamp_ns, held.scan.time_offsets_s);
  return absl::OkStatus();
}

absl::StatusOr<SessionMapper::Readiness> SessionMapper::Prepare(HeldScan& held,
                                                                absl::string_view gave_up) const {
  if (last_stamp_ns_.has_value() && held.scan.stamp_ns <= *last_stamp_ns_) {
    const FieldPath field("scan");
    return wire::Refuse(field.Child("stamp_ns"), absl::StrCat(held.scan.stamp_ns),
                        absl::StrCat("more than the scan's before it, ", *last_stamp_ns_),
                        ProblemReason::kOutOfOrder);
  }
  const bool has_offsets = !held.scan.time_offsets_s.empty();
  if (held.scan.T_O_B.has_value() && !has_offsets) {
    held.T_O_B = *held.scan.T_O_B;
    return Readiness::kReady;
  }
  if (Covers(streamed_, held.span)) {
    // A pose of its own places the scan; the streamed ones tell how the sensor moved meanwhile.
    held.T_O_B = held.scan.T_O_B.has_value() ? *held.scan.T_O_B : *streamed_.At(held.scan.stamp_ns);
    held.deskewing = has_offsets ? Deskewing::kDone : Deskewing::kNotNeeded;
    return Readiness::kReady;
  }
  // Poses come in order: what is missing at the beginning stays missing.
  const bool may_come = streamed_.empty() || streamed_.front().stamp_ns <= held.span.begin_ns;
  if (!held.scan.T_O_B.has_value()) {
    if (may_come && gave_up.empty()) return Readiness::kWaits;
    return RefuseForPose(held, may_come ? gave_up : "poses so old do not come any more");
  }
  // A robot that never streamed a pose sends points with times, but has no use for them.
  if (may_come && gave_up.empty() && !streamed_.empty()) return Readiness::kWaits;
  held.T_O_B = *held.scan.T_O_B;
  held.deskewing = Deskewing::kNotPossible;
  return Readiness::kReady;
}

absl::Status SessionMapper::RefuseForPose(const HeldScan& held, absl::string_view gave_up) const {
  const FieldPath field("scan");
  const std::string wanted =
      held.span.begin_ns == held.span.end_ns
          ? absl::StrCat("around the stamp ", held.scan.stamp_ns)
          : absl::StrCat("from ", held.span.begin_ns, " to ", held.span.end_ns,
                         " around the stamp ", held.scan.stamp_ns);
  const std::string found = streamed_.empty()
                                ? "of which there are none"
                                : absl::StrCat("which span ", streamed_.front().stamp_ns, " to ",
                                               streamed_.back().stamp_ns);
  return wire::Refuse(
      field.Child("odom_from_base"), "unset",
      absl::StrCat("a transform, or streamed poses ", wanted, ", ", found, "; ", gave_up),
      ProblemReason::kNoPose);
}

ScanReport SessionMapper::Fuse(HeldScan& held) {
  if (held.deskewing == Deskewing::kDone)
    Deskew(streamed_, held.scan.stamp_ns, held.sensor->T_B_S, held.scan.time_offsets_s,
           held.scan.points);
  const wire::PoseCovariance covariance = held.scan.covariance.value_or(config_.default_covariance);
  Scan scan;
  scan.seq = held.scan.seq;
  scan.stamp_ns = held.scan.stamp_ns;
  scan.T_O_B = held.T_O_B;
  scan.T_B_S = held.sensor->T_B_S;
  scan.rotation_covariance_rad2 = covariance.rotation_rad2;
  scan.translation_covariance_m2 = covariance.translation_m2;
  scan.noise = held.sensor->noise;
  scan.points = held.scan.points;
  scan.packed = held.scan.packed;
  evicted_.clear();
  const ScanReport report = mapper_->FuseScan(scan, evicted_);

  AppendOdometry(held);
  std::shared_ptr<const Submap> finished = builder_.Add(
      scan.stamp_ns, scan.T_O_B, {covariance.rotation_rad2, covariance.translation_m2}, evicted_);
  if (finished != nullptr) update_.finished.push_back(std::move(finished));
  last_stamp_ns_ = scan.stamp_ns;
  fused_any_ = true;
  return report;
}

void SessionMapper::AppendOdometry(const HeldScan& held) {
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
    for (; pose != poses.end() && pose->stamp_ns < held.scan.stamp_ns; ++pose)
      append(pose->stamp_ns, pose->T_A_B);
  }
  append(held.scan.stamp_ns, held.T_O_B);
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
