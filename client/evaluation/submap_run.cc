#include "client/evaluation/submap_run.h"

#include <utility>

#include "core/base/cancel_token.h"
#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/base/stopwatch.h"

namespace gem::evaluation {
namespace {

constexpr char kSession[] = "session";
constexpr char kRobot[] = "robot";

GlobalMapOptions WithCellOf(const SubmapRun& run, GlobalMapOptions options) {
  if (!run.finished.empty())
    options.cell_size_m = run.finished.front().submap->origin().cell_size_m;
  return options;
}

}  // namespace

absl::StatusOr<std::unique_ptr<SubmapRecorder>> SubmapRecorder::Make(const LocalMapOptions& local,
                                                                     float submap_length_m) {
  GlobalMapOptions map;
  map.cell_size_m = local.cell_size_m;
  map.submap_length_m = submap_length_m;
  GEM_RETURN_IF_ERROR(Validate(map));
  GEM_ASSIGN_OR_RETURN(const NoiseModel noise, MakeNoiseModel(LidarNoise{}));
  auto mapper = MakeLocalMapper(LocalBackend::kCpu, local);
  if (!mapper.ok()) return mapper.status();
  return std::unique_ptr<SubmapRecorder>(new SubmapRecorder(map, noise, *std::move(mapper)));
}

SubmapRecorder::SubmapRecorder(const GlobalMapOptions& map, const NoiseModel& noise,
                               std::unique_ptr<LocalMapper> mapper)
    : noise_(noise), mapper_(std::move(mapper)), builder_(kSession, kRobot, map) {}

SubmapRecorder::Cost SubmapRecorder::Fuse(std::int64_t stamp_ns, const Pose<Odom, Base>& T_O_B,
                                          std::span<const ScanPoint> points) {
  Scan scan;
  scan.seq = run_.odometry.size() + 1;
  scan.stamp_ns = stamp_ns;
  scan.T_O_B = T_O_B;
  scan.noise = noise_;
  scan.points = points;
  evicted_.clear();
  Cost cost;
  cost.local = mapper_->FuseScan(scan, evicted_);
  run_.odometry.push_back({stamp_ns, T_O_B});
  Stopwatch stopwatch;
  auto finished = builder_.Add(stamp_ns, T_O_B, {}, evicted_);
  cost.submap_s = stopwatch.Lap();
  if (finished != nullptr) run_.finished.push_back({run_.odometry.size() - 1, std::move(finished)});
  return cost;
}

void SubmapRecorder::End() {
  evicted_.clear();
  mapper_->EvictAll(evicted_);
  auto finished = builder_.Finish(evicted_);
  if (finished != nullptr) run_.finished.push_back({run_.odometry.size() - 1, std::move(finished)});
}

MapReplay::MapReplay(const SubmapRun& run, GlobalMapOptions options,
                     const Pose<Global, Odom>& T_G_O)
    : run_(run), map_(WithCellOf(run, options), /*epoch=*/1) {
  GEM_CHECK(map_.AddSession(kSession, kRobot, T_G_O).ok());
}

void MapReplay::TellUntil(std::size_t scan) {
  SessionUpdate update;
  for (; next_scan_ <= scan && next_scan_ < run_.odometry.size(); ++next_scan_)
    update.odometry.push_back(run_.odometry[next_scan_]);
  for (; next_submap_ < run_.finished.size() && run_.finished[next_submap_].scan <= scan;
       ++next_submap_)
    update.finished.push_back(run_.finished[next_submap_].submap);
  GEM_CHECK(map_.Update(kSession, std::move(update)).ok());
}

absl::Status MapReplay::Correct(CorrectedTrajectory correction) {
  return map_.Correct(kSession, std::move(correction)).status();
}

CommitReport MapReplay::Commit() {
  CommitReport report;
  map_.Commit(CancelToken(), report);
  return report;
}

CorrectedTrajectory CorrectionOf(const SubmapRun& run,
                                 const std::vector<Pose<Global, Base>>& corrected,
                                 std::size_t count) {
  CorrectedTrajectory correction;
  for (std::size_t i = 0; i < std::min(count, corrected.size()); ++i)
    correction.push_back({run.odometry[i].stamp_ns, corrected[i]});
  return correction;
}

}  // namespace gem::evaluation
