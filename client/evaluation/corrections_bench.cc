#include "client/evaluation/corrections_bench.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <memory>
#include <thread>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/connection.h"
#include "client/evaluation/bench_range.h"
#include "client/evaluation/made_up_drive.h"
#include "client/ingest_client.h"
#include "client/load/server_process.h"
#include "client/map_client.h"
#include "client/simulation/analytic_terrain.h"
#include "client/simulation/lidar.h"
#include "client/simulation/world.h"
#include "core/base/mutex.h"
#include "core/base/status_macros.h"

namespace gem::evaluation {
namespace {

using Clock = std::chrono::steady_clock;

constexpr char kCorrected[] = "corrected";
constexpr char kReference[] = "reference";
constexpr char kSensor[] = "lidar";
constexpr float kCellSize_m = 0.2f;
constexpr double kSensorHeight_m = 1.73;
constexpr double kScanPeriod_s = 0.1;
/// Scans that the robot streams by turns after it has mapped its way.
constexpr std::size_t kSweeps = 8;
/// Threads that send corrections: so many may be on their way at once.
constexpr int kCorrectors = 4;

Clock::duration Seconds(double seconds) {
  return std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
}
double Milliseconds(Clock::duration duration) {
  return std::chrono::duration<double, std::milli>(duration).count();
}

absl::Status Validate(const CorrectionsBenchOptions& options) {
  GEM_RETURN_IF_ERROR(CheckRange("way_m", options.way_m, 20, 100'000));
  GEM_RETURN_IF_ERROR(CheckRange("width_m", options.width_m, 2, 100));
  GEM_RETURN_IF_ERROR(CheckRange("seconds", options.seconds, 0.1, 3600));
  GEM_RETURN_IF_ERROR(CheckRange("block_s", options.block_s, 0.1, 60));
  return CheckRange("corrections_hz", options.corrections_hz, 0.1, 100);
}

/// A street between walls, as a LiDAR of 64 rings and 1900 azimuths sees it: 120,000 points.
std::vector<std::vector<ScanPoint>> CastSweeps() {
  World world(
      std::make_unique<AnalyticTerrain>(GroundPlane{}, std::vector<Hill>{}, std::vector<Step>{}));
  for (const double y_m : {-11.0, 9.0}) world.Add(MakeWall({-90, y_m}, {90, y_m}, 0.3, 0, 12));
  for (const double y_m : {-5.0, 5.0}) world.Add(MakeWall({-90, y_m}, {90, y_m}, 0.2, 0, 0.3));
  LidarOptions options;
  options.azimuths = 1900;
  const Lidar lidar(options);
  const auto T_G_S = Pose<Global, Sensor>::FromTranslation(0, 0, kSensorHeight_m);
  std::vector<std::vector<ScanPoint>> sweeps(kSweeps);
  for (std::size_t i = 0; i < kSweeps; ++i) lidar.Scan(world, T_G_S, 0, /*seed=*/1, i, sweeps[i]);
  return sweeps;
}

/// A point in the middle of every cell of the window: one scan and the strip is mapped.
void CoverWindow(const Pose<Odom, Base>& T_O_B, double width_m, std::vector<ScanPoint>& points) {
  const Pose<Sensor, Odom> T_S_O =
      (T_O_B * Pose<Base, Sensor>::FromTranslation(0, 0, kSensorHeight_m)).Inverse();
  const Eigen::Vector3d& base = T_O_B.translation();
  const CellIndex low = CellAt(base.x() - width_m / 2, base.y() - width_m / 2, kCellSize_m);
  const CellIndex high = CellAt(base.x() + width_m / 2, base.y() + width_m / 2, kCellSize_m);
  points.clear();
  for (CellIndex cell = low; cell.y < high.y; ++cell.y) {
    for (cell.x = low.x; cell.x < high.x; ++cell.x) {
      const Point<Sensor> p_S =
          T_S_O * Point<Odom>(CenterOf(cell.x, kCellSize_m), CenterOf(cell.y, kCellSize_m),
                              MadeUpGroundAt(cell));
      points.push_back({static_cast<float>(p_S.x()), static_cast<float>(p_S.y()),
                        static_cast<float>(p_S.z()), 0});
    }
  }
}

/// The robot of one map. Its scans depend on their number only.
class Robot {
 public:
  static absl::StatusOr<std::unique_ptr<Robot>> Open(
      const std::string& map, const CorrectionsBenchOptions& options,
      const std::vector<std::vector<ScanPoint>>& sweeps,
      const std::shared_ptr<const client::Connection>& connection) {
    GEM_ASSIGN_OR_RETURN(const NoiseModel noise, MakeNoiseModel(LidarNoise{}));
    client::SessionSetup setup;
    setup.map = setup.robot = setup.session = map;
    setup.sensors = {{kSensor, Pose<Base, Sensor>::FromTranslation(0, 0, kSensorHeight_m), noise}};
    setup.side_m = static_cast<float>(options.width_m);
    setup.cell_size_m = kCellSize_m;
    GEM_ASSIGN_OR_RETURN(auto stream, client::IngestClient::Open(connection, setup));
    return std::unique_ptr<Robot>(new Robot(options, sweeps, std::move(stream)));
  }

  std::size_t num_scans() const { return odometry_.size(); }
  const std::vector<StampedPose<Odom, Base>>& odometry() const { return odometry_; }

  /// Maps its way as fast as the server takes it.
  absl::Status MapWay() {
    while (static_cast<double>(num_scans()) * kMadeUpStep_m < options_.way_m) {
      CoverWindow(NextPose().T_A_B, options_.width_m, points_);
      GEM_RETURN_IF_ERROR(Send(points_));
    }
    num_covers_ = num_scans();
    return stream_->WaitUntilFused();
  }
  absl::Status SendSweep() { return Send(sweeps_[(num_scans() - num_covers_) % sweeps_.size()]); }
  absl::Status WaitUntilFused() { return stream_->WaitUntilFused(); }

  absl::Status Close() {
    GEM_ASSIGN_OR_RETURN(const client::SessionClosed closed, stream_->Close());
    if (closed.num_scans_refused == 0) return absl::OkStatus();
    return absl::InternalError(absl::StrCat(closed.num_scans_refused, " scans were refused"));
  }

 private:
  Robot(const CorrectionsBenchOptions& options, const std::vector<std::vector<ScanPoint>>& sweeps,
        std::unique_ptr<client::IngestClient> stream)
      : options_(options), sweeps_(sweeps), stream_(std::move(stream)) {}

  StampedPose<Odom, Base> NextPose() const {
    const auto steps = static_cast<std::int64_t>(num_scans());
    return {(steps + 1) * kMadeUpStep_ns,
            MadeUpPoseAt(static_cast<double>(steps) * kMadeUpStep_m, 2 * options_.width_m)};
  }
  absl::Status Send(const std::vector<ScanPoint>& points) {
    odometry_.push_back(NextPose());
    return stream_->Send(
        {odometry_.back().stamp_ns, kSensor, odometry_.back().T_A_B, std::nullopt, points});
  }

  const CorrectionsBenchOptions& options_;
  const std::vector<std::vector<ScanPoint>>& sweeps_;
  const std::unique_ptr<client::IngestClient> stream_;
  std::vector<StampedPose<Odom, Base>> odometry_;
  std::size_t num_covers_ = 0;
  std::vector<ScanPoint> points_;
};

/// Corrects a map at a rate until it is told to stop; whoever is late does not hold up the others.
class Correctors {
 public:
  Correctors(const client::MapClient& maps, std::vector<StampedPose<Odom, Base>> odometry,
             double rate_hz)
      : maps_(maps), odometry_(std::move(odometry)), period_(Seconds(1 / rate_hz)) {
    for (int i = 0; i < kCorrectors; ++i) threads_.emplace_back([this] { Run(); });
  }

  /// Returns when the last correction is answered.
  absl::Status Stop(std::vector<double>& published_ms) {
    stop_ = true;
    threads_.clear();
    MutexLock lock(mutex_);
    published_ms.insert(published_ms.end(), published_ms_.begin(), published_ms_.end());
    return status_;
  }

 private:
  void Run() {
    while (true) {
      const int number = next_++;
      std::this_thread::sleep_until(start_ + number * period_);
      if (stop_) return;
      client::Correction correction{kCorrected, kCorrected, "", BendDrive(odometry_, 0, number)};
      const Clock::time_point sent = Clock::now();
      const absl::Status status = maps_.CorrectTrajectory(correction).status();
      MutexLock lock(mutex_);
      published_ms_.push_back(Milliseconds(Clock::now() - sent));
      status_.Update(status);
    }
  }

  // Constant after construction.
  const client::MapClient& maps_;
  const std::vector<StampedPose<Odom, Base>> odometry_;
  const Clock::duration period_;
  const Clock::time_point start_ = Clock::now();

  std::atomic<int> next_{0};
  std::atomic<bool> stop_{false};
  Mutex mutex_;
  std::vector<double> published_ms_ ABSL_GUARDED_BY(mutex_);
  absl::Status status_ ABSL_GUARDED_BY(mutex_);
  std::vector<std::jthread> threads_;
};

struct Samples {
  std::vector<double> mapper_ms, fused_ms;
  StreamTiming Summary() const {
    return {mapper_ms.size(), DistributionOf(mapper_ms), DistributionOf(fused_ms)};
  }
};

class Run {
 public:
  Run(const CorrectionsBenchOptions& options, std::shared_ptr<const client::Connection> connection)
      : options_(options),
        connection_(std::move(connection)),
        maps_(connection_),
        sweeps_(CastSweeps()) {}

  absl::StatusOr<CorrectionsBench> Measure() {
    GEM_ASSIGN_OR_RETURN(const auto robot, Robot::Open(kCorrected, options_, sweeps_, connection_));
    GEM_RETURN_IF_ERROR(robot->MapWay());
    CorrectionsBench bench;
    GEM_ASSIGN_OR_RETURN(const client::MapInfo info, maps_.GetMap(kCorrected));
    bench.num_submaps = info.num_submaps;
    bench.num_points = info.num_points;
    Samples warm_up, without, with;
    GEM_RETURN_IF_ERROR(Stream(*robot, /*corrected=*/true, warm_up));
    published_ms_.clear();
    corrected_s_ = 0;
    while (corrected_s_ < options_.seconds) {
      GEM_RETURN_IF_ERROR(Stream(*robot, /*corrected=*/false, without));
      GEM_RETURN_IF_ERROR(Stream(*robot, /*corrected=*/true, with));
    }
    bench.without = without.Summary();
    bench.with = with.Summary();
    bench.num_corrections = published_ms_.size();
    bench.corrections_hz = static_cast<double>(published_ms_.size()) / corrected_s_;
    bench.published = DistributionOf(published_ms_);
    GEM_RETURN_IF_ERROR(Compare(*robot, bench));
    return bench;
  }

 private:
  /// One block of scans, each timed.
  absl::Status Stream(Robot& robot, bool corrected, Samples& samples) {
    std::unique_ptr<Correctors> correctors;
    const Clock::time_point begin = Clock::now();
    if (corrected)
      correctors = std::make_unique<Correctors>(maps_, robot.odometry(), options_.corrections_hz);
    // A little slower than the corrections, so that they meet scans at every phase.
    const auto num_scans = static_cast<int>(options_.block_s / kScanPeriod_s);
    absl::Status status;
    for (int i = 0; i < num_scans && status.ok(); ++i) {
      std::this_thread::sleep_until(begin + Seconds(i * kScanPeriod_s * (1 + 1.0 / num_scans)));
      status = TimeSweep(robot, samples);
    }
    if (!corrected) return status;
    corrected_s_ += std::chrono::duration<double>(Clock::now() - begin).count();
    status.Update(correctors->Stop(published_ms_));
    return status;
  }

  absl::Status TimeSweep(Robot& robot, Samples& samples) {
    GEM_ASSIGN_OR_RETURN(const double before_s, MapperSeconds());
    const Clock::time_point sent = Clock::now();
    GEM_RETURN_IF_ERROR(robot.SendSweep());
    GEM_RETURN_IF_ERROR(robot.WaitUntilFused());
    samples.fused_ms.push_back(Milliseconds(Clock::now() - sent));
    GEM_ASSIGN_OR_RETURN(const double after_s, MapperSeconds());
    samples.mapper_ms.push_back(1e3 * (after_s - before_s));
    return absl::OkStatus();
  }

  /// What all stages of the local mapper have taken so far. There is one robot.
  absl::StatusOr<double> MapperSeconds() const {
    GEM_ASSIGN_OR_RETURN(const client::ServerStatus status, maps_.GetServerStatus());
    double total_s = 0;
    for (const client::StageTiming& timing : status.timings)
      if (timing.mapper == "local") total_s += timing.total_s;
    return total_s;
  }

  /// Ends with one more correction, and gives it and the same scans to a second map.
  absl::Status Compare(Robot& robot, CorrectionsBench& bench) {
    GEM_RETURN_IF_ERROR(Finish(robot, kCorrected));
    GEM_ASSIGN_OR_RETURN(const auto reference,
                         Robot::Open(kReference, options_, sweeps_, connection_));
    GEM_RETURN_IF_ERROR(reference->MapWay());
    while (reference->num_scans() < robot.num_scans()) GEM_RETURN_IF_ERROR(reference->SendSweep());
    GEM_RETURN_IF_ERROR(Finish(*reference, kReference));
    const client::CellSelection all{
        .layers = {Layer::kElevation, Layer::kVariance, Layer::kTraversability},
        .encoding = client::CellEncoding::kRaw};
    GEM_ASSIGN_OR_RETURN(const client::TiledMap is, maps_.ReadMap(kCorrected, std::nullopt, all));
    GEM_ASSIGN_OR_RETURN(const client::TiledMap want, maps_.ReadMap(kReference, std::nullopt, all));
    return Count(is, want, bench);
  }
  absl::Status Finish(Robot& robot, const std::string& map) {
    GEM_RETURN_IF_ERROR(robot.Close());
    return maps_.CorrectTrajectory({map, map, "", BendDrive(robot.odometry(), 0, /*number=*/3)})
        .status();
  }

  static absl::Status Count(const client::TiledMap& is, const client::TiledMap& want,
                            CorrectionsBench& bench) {
    if (is.matrix.tiles != want.matrix.tiles)
      return absl::InternalError(absl::StrFormat("the map has %d tiles, the reference %d others",
                                                 is.matrix.tiles.size(), want.matrix.tiles.size()));
    for (std::size_t i = 0; i < is.tiles.tiles.size(); ++i) {
      const auto& layers = is.tiles.tiles[i].grid->layers;
      const auto& wanted = want.tiles.tiles[i].grid->layers;
      for (std::size_t cell = 0; cell < layers.front().values.size(); ++cell) {
        bool same = true;
        for (std::size_t layer = 0; layer < layers.size(); ++layer)
          same = same && layers[layer].valid[cell] == wanted[layer].valid[cell] &&
                 layers[layer].values[cell] == wanted[layer].values[cell];
        bench.num_cells += wanted.front().valid[cell] != 0 ? 1 : 0;
        bench.num_different_cells += same ? 0 : 1;
      }
    }
    return absl::OkStatus();
  }

  const CorrectionsBenchOptions& options_;
  const std::shared_ptr<const client::Connection> connection_;
  const client::MapClient maps_;
  const std::vector<std::vector<ScanPoint>> sweeps_;
  std::vector<double> published_ms_;
  double corrected_s_ = 0;
};

}  // namespace

absl::StatusOr<CorrectionsBench> BenchCorrections(const CorrectionsBenchOptions& options) {
  GEM_RETURN_IF_ERROR(Validate(options));
  GEM_ASSIGN_OR_RETURN(const auto server, load::ServerProcess::Start());
  return Run(options, std::make_shared<const client::Connection>(
                          client::ConnectionOptions{.address = server->address()}))
      .Measure();
}

std::string CorrectionsBenchJson(const CorrectionsBench& b) {
  const auto of = [](const Distribution_ms& d) {
    return absl::StrFormat("{\"median\":%.4f,\"p95\":%.4f,\"p99\":%.4f}", d.median, d.p95, d.p99);
  };
  const auto stream = [&](const StreamTiming& timing) {
    return absl::StrFormat("{\"scans\":%d,\"mapper_ms\":%s,\"fused_ms\":%s}", timing.num_scans,
                           of(timing.mapper), of(timing.fused));
  };
  return absl::StrFormat(
      "{\"submaps\":%d,\"points\":%d,\"corrections\":%d,\"corrections_hz\":%.2f,\"without\":%s,"
      "\"with\":%s,\"published_ms\":%s,\"cells\":%d,\"different_cells\":%d}\n",
      b.num_submaps, b.num_points, b.num_corrections, b.corrections_hz, stream(b.without),
      stream(b.with), of(b.published), b.num_cells, b.num_different_cells);
}

std::string CorrectionsBenchTable(const CorrectionsBench& b) {
  std::string table = absl::StrFormat(
      "%d submaps, %d points; %d corrections, %.1f a second; %d scans without, %d with\n"
      "%-44s %8s %8s %8s\n",
      b.num_submaps, b.num_points, b.num_corrections, b.corrections_hz, b.without.num_scans,
      b.with.num_scans, "ms", "median", "p95", "p99");
  const auto add = [&table](const char* name, const Distribution_ms& d) {
    absl::StrAppendFormat(&table, "%-44s %8.3f %8.3f %8.3f\n", name, d.median, d.p95, d.p99);
  };
  add("local mapper, a scan, without corrections", b.without.mapper);
  add("local mapper, a scan, with", b.with.mapper);
  add("scan sent to acknowledged, without", b.without.fused);
  add("scan sent to acknowledged, with", b.with.fused);
  add("correction sent to published", b.published);
  absl::StrAppendFormat(&table, "p99 of the local mapper with over without: %.2f\n",
                        b.with.mapper.p99 / b.without.mapper.p99);
  absl::StrAppendFormat(&table,
                        "%d cells in the end, %d of them not what the last correction alone "
                        "gives\n",
                        b.num_cells, b.num_different_cells);
  return table;
}

}  // namespace gem::evaluation
