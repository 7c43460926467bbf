#include "client/cli/stream_run.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <memory>
#include <string>
#include <thread>

#include "absl/strings/str_cat.h"
#include "client/cli/fleet_report.h"
#include "client/cli/json.h"
#include "client/cli/progress_bar.h"
#include "client/ingest_client.h"
#include "client/map_client.h"
#include "core/base/mutex.h"
#include "core/base/status_macros.h"

namespace gem::client {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::uint64_t kProblemsShownMax = 10;

/// What the server refused, collected from a thread of the library.
class ProblemLog {
 public:
  void Add(const IngestProblem& problem) {
    if (problem.reason == "dropped") return;  // as was asked for; the summary counts them
    MutexLock lock(mutex_);
    if (++num_problems_ == 1) first_ = absl::StrCat("scan ", problem.seq, ": ", problem.message);
    if (num_problems_ <= kProblemsShownMax)
      std::fprintf(stderr, "\nscan %llu refused (%s): %s\n",
                   static_cast<unsigned long long>(problem.seq), problem.reason.c_str(),
                   problem.message.c_str());
  }
  std::string first() const {
    MutexLock lock(mutex_);
    return first_;
  }

 private:
  mutable Mutex mutex_;
  std::uint64_t num_problems_ ABSL_GUARDED_BY(mutex_) = 0;
  std::string first_ ABSL_GUARDED_BY(mutex_);
};

/// One run of one source.
class StreamRun {
 public:
  StreamRun(ScanSource& source, const StreamFlags& flags)
      : source_(source), setup_(SetupOf(flags)), flags_(flags) {}

  absl::Status Run() {
    GEM_RETURN_IF_ERROR(Open());
    GEM_RETURN_IF_ERROR(SendAll());
    if (plan_.at_end) GEM_RETURN_IF_ERROR(Correct());
    GEM_ASSIGN_OR_RETURN(const SessionClosed closed, ingest_->Close());
    return Summarise(closed);
  }

 private:
  std::size_t NumScans() const {
    return std::min(source_.num_scans(), flags_.scans.value_or(source_.num_scans()));
  }

  absl::Status Open() {
    GEM_ASSIGN_OR_RETURN(plan_, ParseCorrectAt(flags_.correct_at, NumScans()));
    GEM_ASSIGN_OR_RETURN(rate_hz_, ParseRate(flags_.rate));
    IngestOptions options;
    GEM_RETURN_IF_ERROR(ParseEncoding(flags_.encoding, options));
    GEM_ASSIGN_OR_RETURN(options.overload, ParseOverload(flags_.overload));
    options.on_problem = [this](const IngestProblem& problem) { problems_.Add(problem); };
    sensor_ = source_.noise().along_beam ? "lidar" : "camera";
    setup_.sensors = {{sensor_, source_.T_B_S(), source_.noise()}};
    const auto connection = std::make_shared<const Connection>(ConnectionOptions{flags_.server});
    map_ = std::make_unique<MapClient>(connection);
    GEM_ASSIGN_OR_RETURN(ingest_, IngestClient::Open(connection, setup_, options));
    return absl::OkStatus();
  }

  absl::Status SendAll() {
    const std::uint64_t resume_after_seq = ingest_->opened().resume_after_seq;
    ProgressBar bar(source_.name(), {resume_after_seq, resume_after_seq, NumScans()});
    begin_ = Clock::now();
    SourceScan scan;
    for (std::uint64_t seq = 1; seq <= NumScans(); ++seq) {
      GEM_ASSIGN_OR_RETURN(const bool more, source_.Next(scan));
      if (!more) break;
      GEM_RETURN_IF_ERROR(NoteCorrectedPose(scan));
      // An earlier stream of this session delivered it.
      if (seq <= resume_after_seq) continue;
      if (rate_hz_)
        std::this_thread::sleep_until(
            begin_ + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(
                         static_cast<double>(num_sent_) / *rate_hz_)));
      GEM_RETURN_IF_ERROR(
          ingest_->Send({scan.stamp_ns, sensor_, scan.T_O_B, std::nullopt, scan.points}));
      ++num_sent_;
      num_points_ += scan.points.size();
      bar.Show(seq);
      if (plan_.IsDueAfter(seq)) GEM_RETURN_IF_ERROR(Correct());
    }
    return ingest_->WaitUntilFused();
  }

  absl::Status NoteCorrectedPose(const SourceScan& scan) {
    if (!plan_.any()) return absl::OkStatus();
    if (!scan.T_G_B)
      return absl::InvalidArgumentError(
          "--correct_at needs corrected poses, which this source does not have (replay: give "
          "--corrected FILE)");
    corrected_.push_back({scan.stamp_ns, *scan.T_G_B});
    return absl::OkStatus();
  }

  absl::Status Correct() {
    // The same scans are in the map however fast the server is.
    GEM_RETURN_IF_ERROR(ingest_->WaitUntilFused());
    const Clock::time_point begin = Clock::now();
    GEM_ASSIGN_OR_RETURN(const CorrectionResult result,
                         map_->CorrectTrajectory({setup_.map, setup_.session, "", corrected_}));
    correction_s_max_ = std::max(correction_s_max_, SecondsSince(begin));
    ++num_corrections_;
    num_moved_submaps_ += result.num_moved_submaps;
    num_touched_tiles_ += result.num_touched_tiles;
    return absl::OkStatus();
  }

  absl::Status Summarise(const SessionClosed& closed) const {
    const double seconds = SecondsSince(begin_);
    if (flags_.json) {
      PrintJson(closed, seconds);
    } else {
      PrintText(closed, seconds);
    }
    if (closed.num_scans_refused == 0) return absl::OkStatus();
    return absl::DataLossError(absl::StrCat("the server refused ", closed.num_scans_refused,
                                            " scans; the first: ", problems_.first()));
  }

  void PrintJson(const SessionClosed& closed, double seconds) const {
    const std::string json = absl::StrCat(
        "{\"source\":", JsonText(source_.name()), ",\"map\":", JsonText(setup_.map),
        ",\"robot\":", JsonText(setup_.robot), ",\"session\":", JsonText(setup_.session),
        ",\"num_scans\":", num_sent_, ",\"num_points\":", num_points_,
        ",\"seconds\":", JsonNumber(seconds),
        ",\"resume_after_seq\":", ingest_->opened().resume_after_seq,
        ",\"num_scans_fused\":", closed.num_scans_fused,
        ",\"num_scans_refused\":", closed.num_scans_refused,
        ",\"num_scans_dropped\":", ingest_->progress().num_dropped + closed.num_scans_dropped,
        ",\"num_corrections\":", num_corrections_, ",\"num_moved_submaps\":", num_moved_submaps_,
        ",\"num_touched_tiles\":", num_touched_tiles_,
        ",\"correction_s_max\":", JsonNumber(correction_s_max_), ",", VersionJson(closed.version),
        "}\n");
    std::fputs(json.c_str(), stdout);
  }

  void PrintText(const SessionClosed& closed, double seconds) const {
    std::printf("%s: %llu scans, %llu points in %.2f s (%.1f scans/s)\n", source_.name().c_str(),
                static_cast<unsigned long long>(num_sent_),
                static_cast<unsigned long long>(num_points_), seconds,
                seconds > 0 ? static_cast<double>(num_sent_) / seconds : 0.0);
    if (ingest_->opened().resume_after_seq > 0)
      std::printf("resumed after scan %llu\n",
                  static_cast<unsigned long long>(ingest_->opened().resume_after_seq));
    if (num_corrections_ > 0)
      std::printf("%llu corrections moved %llu submaps and %llu tiles; the longest took %.0f ms\n",
                  static_cast<unsigned long long>(num_corrections_),
                  static_cast<unsigned long long>(num_moved_submaps_),
                  static_cast<unsigned long long>(num_touched_tiles_), correction_s_max_ * 1e3);
    std::printf("map %s, session %s: %llu scans fused, %llu refused; version %llu.%llu\n",
                setup_.map.c_str(), setup_.session.c_str(),
                static_cast<unsigned long long>(closed.num_scans_fused),
                static_cast<unsigned long long>(closed.num_scans_refused),
                static_cast<unsigned long long>(closed.version.epoch),
                static_cast<unsigned long long>(closed.version.revision));
    const std::uint64_t num_dropped_here = ingest_->progress().num_dropped;
    if (num_dropped_here + closed.num_scans_dropped > 0)
      std::printf("dropped for newer ones: %llu scans before they were sent, %llu at the server\n",
                  static_cast<unsigned long long>(num_dropped_here),
                  static_cast<unsigned long long>(closed.num_scans_dropped));
  }

  static double SecondsSince(Clock::time_point begin) {
    return std::chrono::duration<double>(Clock::now() - begin).count();
  }

  ScanSource& source_;
  SessionSetup setup_;
  std::string sensor_;
  const StreamFlags& flags_;
  CorrectionPlan plan_;
  std::optional<double> rate_hz_;
  ProblemLog problems_;  // outlives ingest_, whose threads write to it
  std::unique_ptr<MapClient> map_;
  std::unique_ptr<IngestClient> ingest_;

  std::vector<StampedPose<Global, Base>> corrected_;
  Clock::time_point begin_;
  std::uint64_t num_sent_ = 0;
  std::uint64_t num_points_ = 0;
  std::uint64_t num_corrections_ = 0;
  std::uint64_t num_moved_submaps_ = 0;
  std::uint64_t num_touched_tiles_ = 0;
  double correction_s_max_ = 0;
};

}  // namespace

absl::Status StreamToServer(ScanSource& source, const StreamFlags& flags) {
  return StreamRun(source, flags).Run();
}

}  // namespace gem::client
