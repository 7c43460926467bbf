#include "client/evaluation/mapping_robot.h"

#include <utility>

#include "core/base/cancel_token.h"
#include "core/base/check.h"
#include "core/base/status_macros.h"

namespace gem::evaluation {
namespace {

constexpr char kSession[] = "session";
constexpr char kRobot[] = "robot";

}  // namespace

absl::StatusOr<std::unique_ptr<MappingRobot>> MappingRobot::Make(const RobotSetup& setup) {
  RobotSetup agreed = setup;
  agreed.map.cell_size_m = setup.local.cell_size_m;
  GEM_RETURN_IF_ERROR(Validate(agreed.map));
  auto mapper = MakeLocalMapper(agreed.backend, agreed.local);
  if (!mapper.ok()) return mapper.status();
  return std::unique_ptr<MappingRobot>(new MappingRobot(agreed, *std::move(mapper)));
}

MappingRobot::MappingRobot(const RobotSetup& setup, std::unique_ptr<LocalMapper> mapper)
    : setup_(setup),
      mapper_(std::move(mapper)),
      builder_(kSession, kRobot, setup.map),
      map_(setup.map, /*epoch=*/1) {
  GEM_CHECK(map_.AddSession(kSession, kRobot, {}).ok());
}

ScanReport MappingRobot::Fuse(std::int64_t stamp_ns, const Pose<Odom, Base>& T_O_B,
                              std::span<const ScanPoint> points) {
  Scan scan;
  scan.seq = ++seq_;
  scan.stamp_ns = stamp_ns;
  scan.T_O_B = T_O_B;
  scan.T_B_S = setup_.T_B_S;
  scan.rotation_covariance_rad2 = setup_.rotation_covariance_rad2;
  scan.translation_covariance_m2 = setup_.translation_covariance_m2;
  scan.noise = setup_.noise;
  scan.points = points;
  evicted_.clear();
  const ScanReport report = mapper_->FuseScan(scan, evicted_);
  update_.odometry.push_back({stamp_ns, T_O_B});
  auto finished =
      builder_.Add(stamp_ns, T_O_B,
                   {setup_.rotation_covariance_rad2, setup_.translation_covariance_m2}, evicted_);
  if (finished != nullptr) update_.finished.push_back(std::move(finished));
  return report;
}

CommitReport MappingRobot::Commit(bool show_local) {
  SessionUpdate update = std::exchange(update_, {});
  if (show_local) {
    update.active = builder_.ActiveSnapshot();
    auto local_map = std::make_shared<LocalMap>();
    mapper_->CopyTo(*local_map);
    update.local_map = std::move(local_map);
  }
  GEM_CHECK(map_.Update(kSession, std::move(update)).ok());
  CommitReport report;
  map_.Commit(CancelToken(), report);
  return report;
}

absl::StatusOr<CorrectionCounts> MappingRobot::Correct(CorrectedTrajectory correction) {
  // A correction speaks of odometry, which the map must know first.
  SessionUpdate update = std::exchange(update_, {});
  GEM_CHECK(map_.Update(kSession, std::move(update)).ok());
  return map_.Correct(kSession, std::move(correction));
}

CommitReport MappingRobot::End() {
  SessionUpdate update = std::exchange(update_, {});
  evicted_.clear();
  mapper_->EvictAll(evicted_);
  auto finished = builder_.Finish(evicted_);
  if (finished != nullptr) update.finished.push_back(std::move(finished));
  update.ended = true;
  GEM_CHECK(map_.Update(kSession, std::move(update)).ok());
  CommitReport report;
  map_.Commit(CancelToken(), report);
  return report;
}

}  // namespace gem::evaluation
