// Everything that /metrics shows, except what is computed when it is asked (live_collector.h).
// Handles are resolved once; no label is chosen by a client.
// Thread-safe.
#pragma once

#include <prometheus/counter.h>
#include <prometheus/family.h>
#include <prometheus/gauge.h>
#include <prometheus/histogram.h>
#include <prometheus/registry.h>

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "core/base/mutex.h"
#include "core/global/global_mapper.h"
#include "core/local/local_mapper.h"
#include "proto/wire/refusal.h"

namespace gem {

/// How many took at most upper_s; the last bucket's is infinite.
struct TimingBucket {
  double upper_s = 0;
  std::uint64_t count = 0;
};

/// How long one stage took, since the start.
struct StageTotals {
  std::string mapper;  ///< "local", "global" or "service"
  std::string stage;
  std::uint64_t count = 0;
  double total_s = 0;
  double max_s = 0;
  std::vector<TimingBucket> buckets;
};

/// One RPC, since the start.
struct MethodTotals {
  std::string method;
  std::uint64_t num_started = 0;
  std::uint64_t num_failed = 0;
  int num_active = 0;
  std::uint64_t received_bytes = 0;
  std::uint64_t sent_bytes = 0;
  double total_s = 0;
  std::vector<TimingBucket> buckets;
};

/// Tiles in answers, since the start.
struct TileTotals {
  std::uint64_t num_full = 0;
  std::uint64_t num_absent = 0;
};

/// A histogram that also knows its longest run.
class StageTimer {
 public:
  StageTimer(std::string mapper, std::string stage, prometheus::Histogram& histogram)
      : histogram_(histogram), totals_{std::move(mapper), std::move(stage), 0, 0, 0, {}} {}
  void Observe(double seconds);
  StageTotals totals() const;

 private:
  prometheus::Histogram& histogram_;
  mutable Mutex mutex_;
  StageTotals totals_ ABSL_GUARDED_BY(mutex_);
};

/// Tiles of answers by outcome.
struct TileCounts {
  std::uint64_t full = 0;
  std::uint64_t absent = 0;
  std::uint64_t not_modified = 0;
  std::uint64_t key_only = 0;
};

/// One RPC of the API. Each call begins once and ends once, whatever becomes of it.
class MethodMetrics {
 public:
  struct Series {
    prometheus::Counter& started;
    prometheus::Gauge& active;
    prometheus::Counter& received_bytes;
    prometheus::Counter& sent_bytes;
    prometheus::Counter& sent_messages;
    prometheus::Histogram& seconds;
  };
  MethodMetrics(std::string method, prometheus::Family<prometheus::Counter>& calls,
                const Series& series);
  void Begin();
  /// Messages as protobuf writes them, before any compression.
  void CountReceived(std::size_t bytes) {
    series_.received_bytes.Increment(static_cast<double>(bytes));
  }
  void CountSent(std::size_t bytes) {
    series_.sent_bytes.Increment(static_cast<double>(bytes));
    series_.sent_messages.Increment();
  }
  /// code: "OK", "INVALID_ARGUMENT", ...
  void End(const std::string& code, double seconds);
  MethodTotals totals() const;

 private:
  const std::string method_;
  prometheus::Family<prometheus::Counter>& calls_;
  const Series series_;
  std::atomic<std::uint64_t> num_failed_{0};
};

class Metrics {
 public:
  Metrics();

  const std::shared_ptr<prometheus::Registry>& registry() const { return registry_; }

  /// seconds: from the scan's arrival.
  void ObserveScan(const ScanReport& report, double seconds);
  /// A scan whose points have time offsets was fused; done: there were poses to deskew it with.
  void CountDeskew(bool done) { (done ? deskewed_scans_ : not_deskewed_scans_).Increment(); }
  void CountDuplicateScan() { duplicate_scans_.Increment(); }
  void CountRefusedScan(wire::ProblemReason reason);
  void CountDroppedScans(std::uint64_t num) {
    if (num > 0) dropped_scans_->Increment(static_cast<double>(num));
  }
  void CountPoses(bool accepted) { (accepted ? accepted_poses_ : refused_poses_).Increment(); }
  void ObserveCommit(const CommitReport& report);
  /// From the arrival of a correction to its publication, and the tiles that were rendered for it.
  void ObserveCorrection(double seconds, std::uint32_t num_touched_tiles);
  void CountTiles(const TileCounts& counts);
  /// Published maps, or local maps, that a slow watcher never saw.
  void CountSkippedVersions(std::uint64_t count) {
    skipped_versions_.Increment(static_cast<double>(count));
  }
  /// The reference stays valid as long as the Metrics.
  MethodMetrics& AddMethod(const std::string& method);

  std::vector<StageTotals> Timings() const;
  /// By name.
  std::vector<MethodTotals> Calls() const;
  TileTotals Tiles() const;

 private:
  using Counters = prometheus::Family<prometheus::Counter>;
  using Gauges = prometheus::Family<prometheus::Gauge>;
  using Histograms = prometheus::Family<prometheus::Histogram>;

  static constexpr std::size_t kNumLocalStages = 5;
  static constexpr std::size_t kNumGlobalStages = 5;
  static constexpr std::size_t kNumPointOutcomes = 6;
  static constexpr std::size_t kNumCellOutcomes = 4;

  std::shared_ptr<prometheus::Registry> registry_;
  Counters& calls_;
  Counters& started_calls_;
  Gauges& active_calls_;
  Counters& call_bytes_;
  Counters& sent_messages_;
  Histograms& call_seconds_;
  prometheus::Counter& fused_scans_;
  StageTimer scan_seconds_;
  prometheus::Counter& duplicate_scans_;
  std::array<prometheus::Counter*, wire::kNumProblemReasons> refused_scans_{};
  prometheus::Counter* dropped_scans_ = nullptr;
  prometheus::Counter& deskewed_scans_;
  prometheus::Counter& not_deskewed_scans_;
  prometheus::Counter& accepted_poses_;
  prometheus::Counter& refused_poses_;
  std::array<prometheus::Counter*, kNumPointOutcomes> point_outcomes_{};
  std::array<prometheus::Counter*, kNumCellOutcomes> cell_outcomes_{};
  prometheus::Counter& full_tiles_;
  prometheus::Counter& absent_tiles_;
  prometheus::Counter& not_modified_tiles_;
  prometheus::Counter& key_only_tiles_;
  prometheus::Counter& skipped_versions_;
  prometheus::Counter& published_commits_;
  prometheus::Counter& cancelled_commits_;
  prometheus::Counter& merged_submaps_;
  StageTimer correction_seconds_;
  prometheus::Histogram& correction_tiles_;
  std::vector<std::unique_ptr<StageTimer>> local_stages_;
  std::vector<std::unique_ptr<StageTimer>> global_stages_;

  mutable Mutex mutex_;
  std::vector<std::unique_ptr<MethodMetrics>> methods_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace gem
