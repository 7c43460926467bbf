#include "client/load/serving_bench.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>
#include <optional>
#include <thread>

#include "absl/strings/str_cat.h"
#include "client/load/growth.h"
#include "client/load/robot_load.h"
#include "client/load/server_process.h"
#include "client/load/tile_load.h"
#include "client/load/watch_load.h"
#include "client/map_client.h"
#include "core/base/process_stat.h"
#include "core/base/status_macros.h"

namespace gem::load {
namespace {

constexpr double kLate_s = 0.1;
constexpr double kLateShareMax = 0.01;
constexpr int kMaps = 3;
/// Robots and pieces of the map that is read stand this far apart, metres.
constexpr double kDistance_m = 60;
/// Pieces of the map that is read: each is the tape once.
constexpr int kPieces = 16;
constexpr char kReadMap[] = "read";
/// Before anything is counted, so that caches and connections are warm.
constexpr double kWarmUp_s = 0.5;
/// Until the map and the buffers are as large as they get.
constexpr double kWatchWarmUp_s = 10;
constexpr double kMemoryPeriod_s = 0.5;

Clock::duration Seconds(double seconds) {
  return std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
}

client::ConnectionOptions OwnConnection(const ServerProcess& server) {
  client::ConnectionOptions options;
  options.address = server.address();
  options.exclusive = true;
  return options;
}

/// Processor time of both sides over a stretch of time.
class CpuMeter {
 public:
  explicit CpuMeter(pid_t server) : server_(absl::StrCat(server)) { Restart(); }
  void Restart() {
    begin_ = Clock::now();
    server_s_ = Read(server_);
    own_s_ = Read("self");
  }
  double server_s() const { return Read(server_) - server_s_; }
  double own_s() const { return Read("self") - own_s_; }
  double elapsed_s() const { return std::chrono::duration<double>(Clock::now() - begin_).count(); }

 private:
  static double Read(const std::string& process) {
    const std::optional<ProcessStat> stat = ReadProcessStat(process);
    return stat.has_value() ? stat->cpu_s : 0;
  }

  const std::string server_;
  Clock::time_point begin_;
  double server_s_ = 0;
  double own_s_ = 0;
};

/// Robots with sessions of their own in several maps of one server.
class Fleet {
 public:
  static absl::StatusOr<std::unique_ptr<Fleet>> Open(const ServerProcess& server,
                                                     const ScanTape& tape, int num_robots,
                                                     const std::string& name) {
    auto fleet = std::make_unique<Fleet>();
    for (int i = 0; i < num_robots; ++i) {
      client::SessionSetup setup;
      setup.map = absl::StrCat("site_", i % kMaps);
      setup.robot = absl::StrCat(name, "_", i);
      setup.session = setup.robot;
      setup.T_G_O = Pose<Global, Odom>(Eigen::Quaterniond::Identity(), {kDistance_m * i, 0, 0});
      setup.sensors = tape.sensors();
      fleet->connections_.push_back(std::make_unique<client::Connection>(OwnConnection(server)));
      fleet->robots_.push_back(
          std::make_unique<RobotLoad>(*fleet->connections_.back(), tape, setup));
    }
    for (const auto& robot : fleet->robots_) GEM_RETURN_IF_ERROR(robot->WaitUntilOpened());
    return fleet;
  }

  /// All at 10 Hz, one after the other, until `end`.
  void StreamUntil(Clock::time_point end) {
    const auto period = std::chrono::nanoseconds(kScanPeriod_ns);
    const Clock::time_point begin = Clock::now();
    const auto num_robots = static_cast<std::int64_t>(robots_.size());
    for (std::int64_t i = 0; num_robots > 0; ++i) {
      const Clock::time_point due = begin + period * i / num_robots;
      if (due >= end) return;
      std::this_thread::sleep_until(due);
      robots_[static_cast<std::size_t>(i % num_robots)]->Due();
    }
  }

  void FloodUntil(Clock::time_point end) {
    for (const auto& robot : robots_) robot->FloodUntil(end);
  }

  std::uint64_t num_done() const {
    std::uint64_t sum = 0;
    for (const auto& robot : robots_) sum += robot->num_done();
    return sum;
  }

  absl::StatusOr<RobotsResult> Close() {
    RobotsResult result;
    std::vector<double> latencies_s;
    for (const auto& robot : robots_) {
      GEM_RETURN_IF_ERROR(robot->Close());
      const RobotReport report = robot->report();
      result.num_refused += report.num_refused;
      latencies_s.insert(latencies_s.end(), report.latencies_s.begin(), report.latencies_s.end());
    }
    result.num_robots = static_cast<int>(robots_.size());
    result.num_scans = latencies_s.size();
    result.num_late = static_cast<std::uint64_t>(std::count_if(
        latencies_s.begin(), latencies_s.end(), [](double s) { return s > kLate_s; }));
    result.scan = MillisecondsOf(std::move(latencies_s));
    return result;
  }

 private:
  std::vector<std::unique_ptr<client::Connection>> connections_;
  std::vector<std::unique_ptr<RobotLoad>> robots_;
};

/// The tape, over and over, side by side. Returns the map's tiles.
absl::StatusOr<std::vector<TileIndex>> BuildReadMap(const ServerProcess& server,
                                                    const ScanTape& tape) {
  const auto connection = std::make_shared<const client::Connection>(OwnConnection(server));
  for (int i = 0; i < kPieces; ++i) {
    client::SessionSetup setup;
    setup.map = kReadMap;
    setup.robot = "builder";
    setup.session = absl::StrCat("piece_", i);
    setup.T_G_O = Pose<Global, Odom>(Eigen::Quaterniond::Identity(),
                                     {kDistance_m * (i % 4), kDistance_m * (i / 4), 0});
    setup.sensors = tape.sensors();
    setup.side_m = 40;
    RobotLoad robot(*connection, tape, setup);
    GEM_RETURN_IF_ERROR(robot.WaitUntilOpened());
    for (std::size_t scan = 0; scan < tape.num_scans(); ++scan) robot.Due();
    GEM_RETURN_IF_ERROR(robot.Close());
  }
  GEM_ASSIGN_OR_RETURN(const client::TileMatrix matrix,
                       client::MapClient(connection).GetTileMatrix(kReadMap));
  return matrix.tiles;
}

class ReadingRun {
 public:
  ReadingRun(const ServerProcess& server, const ScanTape& tape, const ServingOptions& options,
             std::vector<TileIndex> tiles)
      : server_(server), tape_(tape), options_(options), tiles_(std::move(tiles)) {}

  /// calls_hz 0: as fast as it goes.
  absl::StatusOr<ReadResult> Run(int num_robots, double calls_hz, int tiles_per_call) {
    GEM_ASSIGN_OR_RETURN(const std::unique_ptr<Fleet> fleet,
                         Fleet::Open(server_, tape_, num_robots, absl::StrCat("run", ++num_runs_)));
    const ReadPlan plan = {kReadMap,       tiles_,   options_.readers,
                           tiles_per_call, calls_hz, options_.seconds};
    std::thread robots(
        [&] { fleet->StreamUntil(Clock::now() + Seconds(kWarmUp_s + options_.seconds)); });
    std::this_thread::sleep_for(Seconds(kWarmUp_s));
    const CpuMeter meter(server_.pid());
    const absl::StatusOr<ReadReport> read = ReadTiles(OwnConnection(server_), plan);
    const double server_cores = meter.server_s() / meter.elapsed_s();
    const double load_cores = meter.own_s() / meter.elapsed_s();
    robots.join();
    if (!read.ok()) return read.status();
    GEM_ASSIGN_OR_RETURN(const RobotsResult result, fleet->Close());
    return ReadResult{tiles_per_call,
                      static_cast<double>(read->latencies_s.size()) / read->seconds,
                      static_cast<double>(read->num_tiles) / read->seconds,
                      static_cast<double>(read->num_bytes) / read->seconds,
                      MillisecondsOf(read->latencies_s),
                      result,
                      server_cores,
                      load_cores};
  }

 private:
  const ServerProcess& server_;
  const ScanTape& tape_;
  const ServingOptions& options_;
  const std::vector<TileIndex> tiles_;
  int num_runs_ = 0;
};

bool Sustained(const RobotsResult& robots) {
  return robots.num_refused == 0 && static_cast<double>(robots.num_late) <=
                                        kLateShareMax * static_cast<double>(robots.num_scans);
}

/// One kind of receiver in every round.
struct IngestRounds {
  std::vector<double> scans_hz, cpu_ms;
};

/// Which of the scans a receiver must refuse.
enum class Refuses : std::uint8_t { kNone, kAll };

absl::Status Flood(const ServerProcess& server, const ScanTape& tape, int num_streams,
                   double seconds, Refuses refuses, IngestRounds& rounds) {
  GEM_ASSIGN_OR_RETURN(
      const std::unique_ptr<Fleet> fleet,
      Fleet::Open(server, tape, num_streams, absl::StrCat("round", rounds.scans_hz.size())));
  fleet->FloodUntil(Clock::now() + Seconds(kWarmUp_s + seconds));
  std::this_thread::sleep_for(Seconds(kWarmUp_s));
  const CpuMeter meter(server.pid());
  const std::uint64_t before = fleet->num_done();
  std::this_thread::sleep_for(Seconds(seconds));
  const auto num_scans = static_cast<double>(fleet->num_done() - before);
  rounds.scans_hz.push_back(num_scans / meter.elapsed_s());
  rounds.cpu_ms.push_back(meter.server_s() / num_scans * 1e3);
  GEM_ASSIGN_OR_RETURN(const RobotsResult result, fleet->Close());
  const std::uint64_t expected = refuses == Refuses::kAll ? result.num_scans : 0;
  if (result.num_refused == expected) return absl::OkStatus();
  return absl::InternalError(absl::StrCat(result.num_refused, " of ", result.num_scans,
                                          " scans were refused, want ", expected));
}

double MedianOf(std::vector<double> values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

IngestRate RateOf(const IngestRounds& rounds, const IngestRounds& bare) {
  std::vector<double> shares;
  for (std::size_t i = 0; i < rounds.scans_hz.size(); ++i)
    shares.push_back(rounds.scans_hz[i] / bare.scans_hz[i]);
  return {MedianOf(rounds.scans_hz), MedianOf(std::move(shares)), MedianOf(rounds.cpu_ms)};
}

}  // namespace

Milliseconds MillisecondsOf(std::vector<double> seconds) {
  if (seconds.empty()) return {};
  std::sort(seconds.begin(), seconds.end());
  // Nearest rank: the value that so many do not exceed.
  const auto at = [&](double q) {
    const auto rank = static_cast<std::size_t>(std::ceil(q * static_cast<double>(seconds.size())));
    return seconds[std::max<std::size_t>(rank, 1) - 1] * 1e3;
  };
  return {at(0.5), at(0.99), seconds.back() * 1e3};
}

absl::StatusOr<ReadingBench> BenchReading(const ScanTape& tape, const ServingOptions& options) {
  GEM_ASSIGN_OR_RETURN(const std::unique_ptr<ServerProcess> server, ServerProcess::Start());
  GEM_ASSIGN_OR_RETURN(std::vector<TileIndex> tiles, BuildReadMap(*server, tape));
  ReadingBench bench;
  bench.num_tiles = tiles.size();
  ReadingRun run(*server, tape, options, std::move(tiles));
  const auto paced = [&](int num_robots) -> absl::StatusOr<bool> {
    GEM_ASSIGN_OR_RETURN(const ReadResult result,
                         run.Run(num_robots, options.paced_calls_hz, /*tiles_per_call=*/1));
    bench.paced.push_back(result);
    return Sustained(result.robots);
  };
  GEM_RETURN_IF_ERROR(paced(0).status());
  for (int num_robots = options.robots_max; num_robots > 0; --num_robots) {
    GEM_ASSIGN_OR_RETURN(const bool sustained, paced(num_robots));
    if (!sustained) continue;
    bench.robots_sustained = num_robots;
    break;
  }
  for (const int num_robots : {0, bench.robots_sustained})
    for (const int tiles_per_call : {1, options.tiles_per_call}) {
      GEM_ASSIGN_OR_RETURN(const ReadResult result, run.Run(num_robots, 0, tiles_per_call));
      bench.flooded.push_back(result);
    }
  return bench;
}

absl::StatusOr<IngestResult> BenchIngest(const ScanTape& tape, const std::string& encoding,
                                         int num_streams, const ServingOptions& options) {
  GEM_ASSIGN_OR_RETURN(const std::unique_ptr<ServerProcess> bare,
                       ServerProcess::StartOwn({"bench", "bare_server"}));
  GEM_ASSIGN_OR_RETURN(const std::unique_ptr<ServerProcess> server, ServerProcess::Start());
  GEM_ASSIGN_OR_RETURN(const std::unique_ptr<ServerProcess> unmapping,
                       ServerProcess::Start({"--pose_wait_s_max", "0"}));
  const std::unique_ptr<const ScanTape> without_poses = tape.WithoutPoses();
  IngestRounds of_bare, of_unmapping, of_server;
  for (int i = 0; i < options.rounds; ++i) {
    GEM_RETURN_IF_ERROR(Flood(*bare, tape, num_streams, options.flood_s, Refuses::kNone, of_bare));
    GEM_RETURN_IF_ERROR(Flood(*unmapping, *without_poses, num_streams, options.flood_s,
                              Refuses::kAll, of_unmapping));
    GEM_RETURN_IF_ERROR(
        Flood(*server, tape, num_streams, options.flood_s, Refuses::kNone, of_server));
  }
  return IngestResult{encoding,
                      num_streams,
                      tape.mean_payload_bytes(),
                      RateOf(of_bare, of_bare),
                      RateOf(of_unmapping, of_bare),
                      RateOf(of_server, of_bare)};
}

absl::StatusOr<WatchResult> BenchWatching(const ScanTape& tape, int num_watchers,
                                          const ServingOptions& options) {
  GEM_ASSIGN_OR_RETURN(const std::unique_ptr<ServerProcess> server, ServerProcess::Start());
  GEM_ASSIGN_OR_RETURN(const std::unique_ptr<Fleet> fleet, Fleet::Open(*server, tape, 1, "driver"));
  std::vector<std::unique_ptr<client::Connection>> connections;
  std::vector<std::unique_ptr<WatchLoad>> watchers;
  for (int i = 0; i < num_watchers; ++i) {
    connections.push_back(std::make_unique<client::Connection>(OwnConnection(*server)));
    const bool reads = i + 1 < num_watchers;
    watchers.push_back(std::make_unique<WatchLoad>(*connections.back(), "site_0", reads));
  }
  const auto total = [&] {
    WatchReport sum;
    for (const auto& watcher : watchers) {
      sum.num_messages += watcher->report().num_messages;
      sum.num_bytes += watcher->report().num_bytes;
    }
    return sum;
  };
  const Clock::time_point begin = Clock::now() + Seconds(kWatchWarmUp_s);
  std::thread robot([&] { fleet->StreamUntil(begin + Seconds(options.watch_s)); });
  std::this_thread::sleep_until(begin);
  const WatchReport before = total();
  std::vector<double> resident_bytes;
  for (Clock::time_point next = begin; next < begin + Seconds(options.watch_s);
       next += Seconds(kMemoryPeriod_s)) {
    std::this_thread::sleep_until(next);
    if (const auto stat = ReadProcessStat(absl::StrCat(server->pid())))
      resident_bytes.push_back(static_cast<double>(stat->resident_bytes));
  }
  robot.join();
  const WatchReport after = total();
  for (const auto& watcher : watchers)
    if (watcher->end().has_value()) return *watcher->end();
  GEM_ASSIGN_OR_RETURN(const RobotsResult robots, fleet->Close());
  const Growth memory = GrowthOf(resident_bytes);
  return WatchResult{
      num_watchers,
      std::min(num_watchers, 1),
      static_cast<double>(after.num_messages - before.num_messages) / options.watch_s,
      static_cast<double>(after.num_bytes - before.num_bytes) / options.watch_s,
      memory.median,
      memory.growth,
      memory.max,
      robots};
}

}  // namespace gem::load
