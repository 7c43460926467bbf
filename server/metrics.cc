#include "server/metrics.h"

#include <algorithm>
#include <string>

namespace gem {
namespace {

using prometheus::Histogram;

constexpr std::array<const char*, 5> kLocalStages = {"move", "measure", "fuse", "annotate",
                                                     "clear"};
constexpr std::array<const char*, 5> kGlobalStages = {"finish", "merge", "deform", "compose",
                                                      "coarsen"};
constexpr std::array<const char*, 6> kPointOutcomes = {
    "fused", "gated", "outside_window", "out_of_range", "out_of_height", "on_body"};
constexpr std::array<const char*, 4> kCellOutcomes = {"evicted", "restarted", "inflated",
                                                      "cleared"};

// Every objective is an edge, so that the share of what met it is exact: 100 ms (the period of
// scans; a scan, a correction), 5 ms (an answer with tiles), 200 ms (pose_wait_s_max).
/// Finest where stages live.
const Histogram::BucketBoundaries kSeconds = {0.00001, 0.000025, 0.00005, 0.0001, 0.00025, 0.0005,
                                              0.001,   0.0025,   0.005,   0.01,   0.025,   0.05,
                                              0.075,   0.1,      0.25,    0.5,    1.0};
/// What waits in queues.
const Histogram::BucketBoundaries kWaitSeconds = {0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.075,
                                                  0.1,   0.15,   0.2,   0.5,  1.0,   2.5,  10.0};
/// Calls, and the lives of streams.
const Histogram::BucketBoundaries kCallSeconds = {0.0005, 0.001, 0.0025, 0.005, 0.01, 0.025,
                                                  0.05,   0.1,   0.25,   0.5,   1.0,  2.5,
                                                  10.0,   60.0,  600.0,  3600.0};
const Histogram::BucketBoundaries kTiles = {1, 2, 5, 10, 20, 50, 100, 200, 500, 1000};

prometheus::Family<prometheus::Counter>& CounterFamily(prometheus::Registry& registry,
                                                       const char* name, const char* help) {
  return prometheus::BuildCounter().Name(name).Help(help).Register(registry);
}
prometheus::Family<prometheus::Gauge>& GaugeFamily(prometheus::Registry& registry, const char* name,
                                                   const char* help) {
  return prometheus::BuildGauge().Name(name).Help(help).Register(registry);
}
prometheus::Family<Histogram>& HistogramFamily(prometheus::Registry& registry, const char* name,
                                               const char* help) {
  return prometheus::BuildHistogram().Name(name).Help(help).Register(registry);
}

std::vector<TimingBucket> BucketsOf(const prometheus::ClientMetric::Histogram& histogram) {
  std::vector<TimingBucket> buckets;
  buckets.reserve(histogram.bucket.size());
  for (const auto& bucket : histogram.bucket)
    buckets.push_back({bucket.upper_bound, bucket.cumulative_count});
  return buckets;
}

std::uint64_t CountOf(const prometheus::Counter& counter) {
  return static_cast<std::uint64_t>(counter.Value());
}

}  // namespace

void StageTimer::Observe(double seconds) {
  histogram_.Observe(seconds);
  MutexLock lock(mutex_);
  ++totals_.count;
  totals_.total_s += seconds;
  totals_.max_s = std::max(totals_.max_s, seconds);
}

StageTotals StageTimer::totals() const {
  StageTotals totals;
  {
    MutexLock lock(mutex_);
    totals = totals_;
  }
  totals.buckets = BucketsOf(histogram_.Collect().histogram);
  return totals;
}

MethodMetrics::MethodMetrics(std::string method, prometheus::Family<prometheus::Counter>& calls,
                             const Series& series)
    : method_(std::move(method)), calls_(calls), series_(series) {
  // There before the first call: a rate needs a zero to start from.
  calls_.Add({{"method", method_}, {"code", "OK"}});
}

void MethodMetrics::Begin() {
  series_.started.Increment();
  series_.active.Increment();
}

void MethodMetrics::End(const std::string& code, double seconds) {
  series_.active.Decrement();
  series_.seconds.Observe(seconds);
  if (code != "OK") num_failed_.fetch_add(1, std::memory_order_relaxed);
  // Not resolved once: most of the codes never happen, and a call costs far more than the look-up.
  calls_.Add({{"method", method_}, {"code", code}}).Increment();
}

MethodTotals MethodMetrics::totals() const {
  const auto histogram = series_.seconds.Collect().histogram;
  return {method_,
          CountOf(series_.started),
          num_failed_.load(std::memory_order_relaxed),
          static_cast<int>(series_.active.Value()),
          CountOf(series_.received_bytes),
          CountOf(series_.sent_bytes),
          histogram.sample_sum,
          BucketsOf(histogram)};
}

Metrics::Metrics()
    : registry_(std::make_shared<prometheus::Registry>()),
      calls_(CounterFamily(*registry_, "gem_rpc_total", "Calls by method and code")),
      started_calls_(CounterFamily(*registry_, "gem_rpc_started_total", "Calls that began")),
      active_calls_(
          GaugeFamily(*registry_, "gem_rpc_active_calls", "Calls and streams in progress")),
      call_bytes_(CounterFamily(*registry_, "gem_rpc_bytes_total",
                                "Bytes of messages by method and direction, before compression")),
      sent_messages_(
          CounterFamily(*registry_, "gem_rpc_sent_messages_total", "Messages sent by method")),
      call_seconds_(
          HistogramFamily(*registry_, "gem_rpc_seconds",
                          "Time from the call's start to its answer; streams: their life")),
      fused_scans_(
          CounterFamily(*registry_, "gem_scans_total", "Scans by result, refused ones by reason")
              .Add({{"result", "fused"}, {"reason", ""}})),
      scan_seconds_("service", "scan",
                    HistogramFamily(*registry_, "gem_scan_seconds",
                                    "From the arrival of a scan to its place in the local map")
                        .Add({}, kWaitSeconds)),
      duplicate_scans_(
          CounterFamily(*registry_, "gem_scans_total", "Scans by result, refused ones by reason")
              .Add({{"result", "duplicate"}, {"reason", ""}})),
      deskewed_scans_(
          CounterFamily(*registry_, "gem_deskewed_scans_total",
                        "Fused scans with time offsets by whether poses covered their time span")
              .Add({{"result", "deskewed"}})),
      not_deskewed_scans_(
          CounterFamily(*registry_, "gem_deskewed_scans_total",
                        "Fused scans with time offsets by whether poses covered their time span")
              .Add({{"result", "as_it_comes"}})),
      accepted_poses_(
          CounterFamily(*registry_, "gem_pose_batches_total", "Batches of streamed poses by result")
              .Add({{"result", "accepted"}})),
      refused_poses_(
          CounterFamily(*registry_, "gem_pose_batches_total", "Batches of streamed poses by result")
              .Add({{"result", "refused"}})),
      full_tiles_(CounterFamily(*registry_, "gem_tiles_served_total", "Tiles of answers by outcome")
                      .Add({{"outcome", "full"}})),
      absent_tiles_(
          CounterFamily(*registry_, "gem_tiles_served_total", "Tiles of answers by outcome")
              .Add({{"outcome", "absent"}})),
      not_modified_tiles_(
          CounterFamily(*registry_, "gem_tiles_served_total", "Tiles of answers by outcome")
              .Add({{"outcome", "not_modified"}})),
      key_only_tiles_(
          CounterFamily(*registry_, "gem_tiles_served_total", "Tiles of answers by outcome")
              .Add({{"outcome", "key_only"}})),
      skipped_versions_(
          CounterFamily(*registry_, "gem_watch_skipped_total",
                        "Published maps and local maps that watchers were too slow to get")
              .Add({})),
      published_commits_(CounterFamily(*registry_, "gem_commits_total",
                                       "Renderings of a map; cancelled ones start again")
                             .Add({{"result", "published"}})),
      cancelled_commits_(CounterFamily(*registry_, "gem_commits_total",
                                       "Renderings of a map; cancelled ones start again")
                             .Add({{"result", "cancelled"}})),
      merged_submaps_(CounterFamily(*registry_, "gem_merged_submaps_total",
                                    "Submaps that were merged into a neighbour")
                          .Add({})),
      correction_seconds_("service", "correction",
                          HistogramFamily(*registry_, "gem_correction_seconds",
                                          "From the arrival of a correction to its publication")
                              .Add({}, kWaitSeconds)),
      correction_tiles_(HistogramFamily(*registry_, "gem_correction_tiles",
                                        "Tiles that were rendered for a correction")
                            .Add({}, kTiles)) {
  Counters& scans =
      CounterFamily(*registry_, "gem_scans_total", "Scans by result, refused ones by reason");
  dropped_scans_ = &scans.Add({{"result", "dropped"}, {"reason", "overload"}});
  for (int i = 1; i < static_cast<int>(wire::ProblemReason::kDropped); ++i)
    refused_scans_[static_cast<std::size_t>(i)] =
        &scans.Add({{"result", "refused"},
                    {"reason", std::string(wire::NameOf(static_cast<wire::ProblemReason>(i)))}});
  prometheus::BuildGauge()
      .Name("gem_build_info")
      .Help("1; the label says which release runs")
      .Register(*registry_)
      .Add({{"version", GEM_VERSION}})
      .Set(1);
  Counters& points =
      CounterFamily(*registry_, "gem_scan_points_total", "Points by what became of them");
  for (std::size_t i = 0; i < kPointOutcomes.size(); ++i)
    point_outcomes_[i] = &points.Add({{"outcome", kPointOutcomes[i]}});
  Counters& cells = CounterFamily(*registry_, "gem_cells_total", "Cells of local maps by event");
  for (std::size_t i = 0; i < kCellOutcomes.size(); ++i)
    cell_outcomes_[i] = &cells.Add({{"event", kCellOutcomes[i]}});
  Histograms& local = HistogramFamily(*registry_, "gem_local_stage_seconds",
                                      "Time of one stage of the local mapper, a scan");
  for (const char* stage : kLocalStages)
    local_stages_.push_back(
        std::make_unique<StageTimer>("local", stage, local.Add({{"stage", stage}}, kSeconds)));
  Histograms& global = HistogramFamily(*registry_, "gem_global_stage_seconds",
                                       "Time of one stage of the global mapper, a commit");
  for (const char* stage : kGlobalStages)
    global_stages_.push_back(
        std::make_unique<StageTimer>("global", stage, global.Add({{"stage", stage}}, kSeconds)));
}

void Metrics::ObserveScan(const ScanReport& report, double seconds) {
  fused_scans_.Increment();
  scan_seconds_.Observe(seconds);
  const LocalStageSeconds& s = report.seconds;
  const std::array<double, kNumLocalStages> stages = {s.move, s.measure, s.fuse, s.annotate,
                                                      s.clear};
  for (std::size_t i = 0; i < stages.size(); ++i) local_stages_[i]->Observe(stages[i]);
  const std::array<std::uint64_t, kNumPointOutcomes> points = {
      report.points_fused,        report.points_gated,         report.points_outside_window,
      report.points_out_of_range, report.points_out_of_height, report.points_on_body};
  for (std::size_t i = 0; i < points.size(); ++i)
    point_outcomes_[i]->Increment(static_cast<double>(points[i]));
  const std::array<std::uint64_t, kNumCellOutcomes> cells = {
      report.cells_evicted, report.cells_restarted, report.cells_inflated, report.cells_cleared};
  for (std::size_t i = 0; i < cells.size(); ++i)
    cell_outcomes_[i]->Increment(static_cast<double>(cells[i]));
}

void Metrics::CountRefusedScan(wire::ProblemReason reason) {
  refused_scans_[static_cast<std::size_t>(reason)]->Increment();
}

void Metrics::ObserveCommit(const CommitReport& report) {
  (report.cancelled ? cancelled_commits_ : published_commits_).Increment();
  merged_submaps_.Increment(report.num_merged_submaps);
  const GlobalStageSeconds& s = report.seconds;
  const std::array<double, kNumGlobalStages> seconds = {s.finish, s.merge, s.deform, s.compose,
                                                        s.coarsen};
  // 0: the stage did not run.
  for (std::size_t i = 0; i < seconds.size(); ++i)
    if (seconds[i] > 0) global_stages_[i]->Observe(seconds[i]);
}

void Metrics::ObserveCorrection(double seconds, std::uint32_t num_touched_tiles) {
  correction_seconds_.Observe(seconds);
  correction_tiles_.Observe(num_touched_tiles);
}

void Metrics::CountTiles(const TileCounts& counts) {
  full_tiles_.Increment(static_cast<double>(counts.full));
  absent_tiles_.Increment(static_cast<double>(counts.absent));
  not_modified_tiles_.Increment(static_cast<double>(counts.not_modified));
  key_only_tiles_.Increment(static_cast<double>(counts.key_only));
}

MethodMetrics& Metrics::AddMethod(const std::string& method) {
  const prometheus::Labels labels = {{"method", method}};
  const MethodMetrics::Series series = {
      started_calls_.Add(labels),
      active_calls_.Add(labels),
      call_bytes_.Add({{"method", method}, {"direction", "received"}}),
      call_bytes_.Add({{"method", method}, {"direction", "sent"}}),
      sent_messages_.Add(labels),
      call_seconds_.Add(labels, kCallSeconds)};
  MutexLock lock(mutex_);
  methods_.push_back(std::make_unique<MethodMetrics>(method, calls_, series));
  return *methods_.back();
}

std::vector<StageTotals> Metrics::Timings() const {
  std::vector<StageTotals> timings;
  for (const auto& stage : local_stages_) timings.push_back(stage->totals());
  for (const auto& stage : global_stages_) timings.push_back(stage->totals());
  timings.push_back(scan_seconds_.totals());
  timings.push_back(correction_seconds_.totals());
  return timings;
}

std::vector<MethodTotals> Metrics::Calls() const {
  std::vector<MethodTotals> calls;
  {
    MutexLock lock(mutex_);
    for (const auto& method : methods_) calls.push_back(method->totals());
  }
  std::sort(calls.begin(), calls.end(),
            [](const auto& a, const auto& b) { return a.method < b.method; });
  return calls;
}

TileTotals Metrics::Tiles() const { return {CountOf(full_tiles_), CountOf(absent_tiles_)}; }

}  // namespace gem
