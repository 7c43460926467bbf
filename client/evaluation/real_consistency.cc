#include "client/evaluation/real_consistency.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/datasets/kitti_source.h"
#include "client/evaluation/revisits.h"
#include "client/evaluation/submap_run.h"
#include "core/base/status_macros.h"

namespace gem::evaluation {
namespace {

struct Recorded {
  std::unique_ptr<SubmapRecorder> odometry;
  std::unique_ptr<SubmapRecorder> from_start;
  std::vector<Pose<Global, Base>> corrected;
};

absl::StatusOr<Recorded> MapRecording(const std::filesystem::path& dir, const Settings& settings) {
  GEM_ASSIGN_OR_RETURN(const std::unique_ptr<KittiSource> source,
                       KittiSource::Open({.dir = dir.string(),
                                          .poses = "poses_odometry.txt",
                                          .corrected = "poses_corrected.txt",
                                          .pose_frame = KittiPoseFrame::kVelodyne}));
  LocalMapOptions local;
  local.side_m = 12;
  const float submap_length_m = GlobalMapOptions().submap_length_m;
  Recorded recorded;
  GEM_ASSIGN_OR_RETURN(recorded.odometry, SubmapRecorder::Make(local, submap_length_m));
  GEM_ASSIGN_OR_RETURN(recorded.from_start, SubmapRecorder::Make(local, submap_length_m));
  SourceScan scan;
  const auto scans_max = std::max<std::size_t>(
      10, static_cast<std::size_t>(settings.scale * static_cast<double>(source->num_scans())));
  while (recorded.corrected.size() < scans_max) {
    GEM_ASSIGN_OR_RETURN(const bool more, source->Next(scan));
    if (!more) break;
    const Pose<Global, Base>& T_G_B = *scan.T_G_B;
    recorded.corrected.push_back(T_G_B);
    recorded.odometry->Fuse(scan.stamp_ns, scan.T_O_B, scan.points);
    recorded.from_start->Fuse(scan.stamp_ns, {T_G_B.rotation(), T_G_B.translation()}, scan.points);
  }
  recorded.odometry->End();
  recorded.from_start->End();
  return recorded;
}

}  // namespace

absl::Status AddRealConsistency(const std::filesystem::path& dir, const Settings& settings,
                                Report& report) {
  GEM_ASSIGN_OR_RETURN(const Recorded recorded, MapRecording(dir, settings));
  const SubmapRun& run = recorded.odometry->run();
  const std::size_t count = recorded.corrected.size();
  const Pose<Global, Odom> T_G_O =
      recorded.corrected.front() * run.odometry.front().T_A_B.Inverse();
  GlobalMapOptions options;
  options.merge_overlap_min = 1000;

  MapReplay from_start(recorded.from_start->run(), options, {});
  from_start.TellUntil(count);
  from_start.Commit();
  MapReplay deformed(run, options, T_G_O);
  deformed.TellUntil(count);
  deformed.Commit();
  const Deviation before = DeviationBetween(deformed.snapshot(), from_start.snapshot());
  GEM_RETURN_IF_ERROR(deformed.Correct(CorrectionOf(run, recorded.corrected, count)));
  deformed.Commit();
  const Deviation after = DeviationBetween(deformed.snapshot(), from_start.snapshot());

  report.figures.push_back(
      {.name = "real scans: map by odometry against map from corrected poses, median",
       .value = 100 * before.median_m,
       .unit = "cm"});
  report.figures.push_back(
      {.name = "real scans: deformed map against map from corrected poses, median",
       .value = 100 * after.median_m,
       .unit = "cm"});
  Table table;
  table.title = absl::StrCat("kitti_00_keyframes, ", count,
                             " real scans: free cells of both maps, against the map that is built "
                             "from the corrected poses, cm");
  table.columns = {"map", "cells", "rms", "median", "95 %"};
  const auto row = [](const std::string& name, const Deviation& d) {
    return std::vector<std::string>{
        name, absl::StrCat(d.cells), absl::StrFormat("%.1f", 100 * d.rms_m),
        absl::StrFormat("%.1f", 100 * d.median_m), absl::StrFormat("%.1f", 100 * d.p95_m)};
  };
  table.rows = {row("left where odometry put it", before), row("deformed", after)};
  report.tables.push_back(std::move(table));
  return absl::OkStatus();
}

}  // namespace gem::evaluation
