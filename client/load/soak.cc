#include "client/load/soak.h"

#include <grpcpp/grpcpp.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <memory>
#include <random>
#include <thread>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/call_status.h"
#include "client/load/robot_load.h"
#include "client/load/server_process.h"
#include "client/load/tile_load.h"
#include "client/load/watch_load.h"
#include "client/map_client.h"
#include "core/base/mutex.h"
#include "core/base/process_stat.h"
#include "core/base/status_macros.h"
#include "gem/v1/map_service.grpc.pb.h"

namespace gem::load {
namespace {

constexpr int kMaps = 3;
constexpr std::chrono::milliseconds kScanPeriod(50);
constexpr std::chrono::seconds kSamplePeriod(1);
constexpr std::chrono::seconds kMapLife(20);
constexpr double kDeadline_s = 20;

/// Small limits, so that all of them are reached within the warm-up: what grows after it is lost.
std::vector<std::string> ServerFlags() {
  return {"--session_idle_s_max",   "2",       "--ended_sessions_max", "8",
          "--revision_retention_s", "2",       "--request_ids_max",    "10",
          "--tile_cache_bytes_max", "8388608", "--log_level",          "error"};
}

/// What everybody shares.
class Stage {
 public:
  Stage(std::string address, const ScanTape& tape, Clock::time_point end)
      : address_(std::move(address)), tape_(tape), end_(end) {}

  const ScanTape& tape() const { return tape_; }
  bool over() const { return failed_ || Clock::now() >= end_; }
  void SleepFor(Clock::duration duration) const {
    std::this_thread::sleep_until(std::min(Clock::now() + duration, end_));
  }

  client::ConnectionOptions NewConnection() const {
    client::ConnectionOptions options;
    options.address = address_;
    options.exclusive = true;
    return options;
  }
  std::shared_ptr<const client::Connection> Connect() const {
    return std::make_shared<const client::Connection>(NewConnection());
  }

  /// A refusal is counted; what a server must never say ends the run.
  void Note(const absl::Status& status) {
    MutexLock lock(mutex_);
    if (status.ok()) return;
    switch (status.code()) {
      case absl::StatusCode::kInternal:
      case absl::StatusCode::kUnknown:
      case absl::StatusCode::kDataLoss:
      case absl::StatusCode::kUnavailable:
      case absl::StatusCode::kDeadlineExceeded:
        if (failure_.ok()) failure_ = status;
        failed_ = true;
        break;
      default:
        ++counts_.refusals;
    }
  }
  void Count(std::uint64_t SoakCounts::*what, std::uint64_t number = 1) {
    MutexLock lock(mutex_);
    counts_.*what += number;
  }
  SoakCounts counts() const {
    MutexLock lock(mutex_);
    return counts_;
  }
  absl::Status failure() const {
    MutexLock lock(mutex_);
    return failure_;
  }

 private:
  const std::string address_;
  const ScanTape& tape_;
  const Clock::time_point end_;
  std::atomic<bool> failed_{false};

  mutable Mutex mutex_;
  SoakCounts counts_ ABSL_GUARDED_BY(mutex_);
  absl::Status failure_ ABSL_GUARDED_BY(mutex_);
};

std::string MapNumber(int number) { return absl::StrCat("soak_", number); }

/// One who comes and goes. Deterministic but for timing.
class Player {
 public:
  Player(Stage& stage, std::string name, std::uint64_t seed)
      : stage_(stage), name_(std::move(name)), random_(seed) {}

 protected:
  bool Chance(double share) { return std::uniform_real_distribution<>(0, 1)(random_) < share; }
  int Between(int low, int high) { return std::uniform_int_distribution<>(low, high)(random_); }
  std::string AnyMap() { return MapNumber(Between(0, kMaps - 1)); }

  Stage& stage_;
  const std::string name_;

 private:
  std::mt19937_64 random_;
};

class SoakRobot : Player {
 public:
  using Player::Player;

  void Run() {
    for (int number = 0; !stage_.over(); ++number) {
      client::SessionSetup setup;
      setup.map = AnyMap();
      setup.robot = name_;
      setup.session = absl::StrCat(name_, "_", number);
      setup.T_G_O = Pose<Global, Odom>::FromTranslation(Between(-50, 50), Between(-50, 50), 0);
      setup.sensors = stage_.tape().sensors();
      stage_.Count(&SoakCounts::sessions);
      stage_.Note(Live(setup));
    }
  }

 private:
  absl::Status Live(const client::SessionSetup& setup) {
    const auto connection = stage_.Connect();
    auto robot = std::make_unique<RobotLoad>(*connection, stage_.tape(), setup);
    GEM_RETURN_IF_ERROR(robot->WaitUntilOpened());
    Stream(*robot, Between(5, 60));
    if (Chance(0.4)) {
      stage_.Count(&SoakCounts::cuts);
      robot.reset();
      // Who does not come back is ended by the server.
      if (Chance(0.5)) return absl::OkStatus();
      robot = std::make_unique<RobotLoad>(*connection, stage_.tape(), setup);
      GEM_RETURN_IF_ERROR(robot->WaitUntilOpened());
      Stream(*robot, Between(5, 30));
    }
    if (Chance(0.5)) stage_.Note(Correct(connection, setup));
    const absl::Status closed = robot->Close();
    stage_.Count(&SoakCounts::scans, robot->num_done());
    return closed;
  }

  void Stream(RobotLoad& robot, int num_scans) {
    for (int i = 0; i < num_scans && !stage_.over(); ++i) {
      robot.Due();
      stage_.SleepFor(kScanPeriod);
    }
  }

  absl::Status Correct(const std::shared_ptr<const client::Connection>& connection,
                       const client::SessionSetup& setup) {
    client::Correction correction{setup.map, setup.session, "", {}};
    for (int i = 1; i <= 20; ++i)
      correction.poses.push_back(
          {i * kScanPeriod_ns, Pose<Global, Base>::FromTranslation(Between(-50, 50), i * 0.1, 0)});
    stage_.Count(&SoakCounts::corrections);
    return client::MapClient(connection).CorrectTrajectory(correction).status();
  }
};

class SoakPlanner : Player {
 public:
  using Player::Player;

  void Run() {
    while (!stage_.over()) {
      stage_.Note(Live());
      stage_.SleepFor(std::chrono::milliseconds(Between(0, 500)));
    }
  }

 private:
  absl::Status Live() {
    const client::MapClient client(stage_.Connect(), {kDeadline_s, kDeadline_s, 20, 3});
    GEM_RETURN_IF_ERROR(client.ListMaps().status());
    GEM_RETURN_IF_ERROR(client.GetServerStatus().status());
    const std::string map = AnyMap();
    GEM_ASSIGN_OR_RETURN(const client::TileMatrix matrix, client.GetTileMatrix(map));
    if (matrix.tiles.empty()) return absl::OkStatus();
    ReadPlan plan;
    plan.map = map;
    plan.tiles = matrix.tiles;
    plan.tiles_per_call = Between(1, 16);
    plan.calls_hz = 50;
    plan.seconds = 1;
    GEM_ASSIGN_OR_RETURN(const ReadReport read, ReadTiles(stage_.NewConnection(), plan));
    stage_.Count(&SoakCounts::tiles, read.num_tiles);
    return client.GetLocalMap(absl::StrCat("robot_", Between(0, 1)), {}).status();
  }
};

class SoakWatcher : Player {
 public:
  using Player::Player;

  void Run() {
    while (!stage_.over()) {
      const auto connection = stage_.Connect();
      const WatchLoad watch(*connection, AnyMap(), /*reads=*/Chance(0.75));
      stage_.Count(&SoakCounts::watches);
      stage_.SleepFor(std::chrono::milliseconds(Between(100, 5000)));
      if (const auto end = watch.end()) stage_.Note(*end);
    }
  }
};

/// Makes and deletes maps under the feet of all others.
class SoakKeeper : Player {
 public:
  using Player::Player;

  void Run() {
    const auto connection = stage_.Connect();
    const auto stub = v1::MapService::NewStub(connection->channel());
    for (int number = 0; !stage_.over(); ++number) {
      v1::CreateMapRequest create;
      create.set_map(MapNumber(number % kMaps));
      v1::CreateMapResponse created;
      stage_.Note(Call(*stub, &v1::MapService::Stub::CreateMap, create, created));
      stage_.SleepFor(kMapLife / kMaps);
      v1::DeleteMapRequest remove;
      remove.set_map(MapNumber((number + 1) % kMaps));
      remove.set_force(true);
      v1::DeleteMapResponse removed;
      const absl::Status status = Call(*stub, &v1::MapService::Stub::DeleteMap, remove, removed);
      if (status.ok()) stage_.Count(&SoakCounts::maps_deleted);
      stage_.Note(status);
    }
  }

 private:
  template <typename Request, typename Response>
  static absl::Status Call(v1::MapService::Stub& stub,
                           grpc::Status (v1::MapService::Stub::*method)(grpc::ClientContext*,
                                                                        const Request&, Response*),
                           const Request& request, Response& response) {
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() +
                         std::chrono::seconds(static_cast<int>(kDeadline_s)));
    return client::ToStatus((stub.*method)(&context, request, &response), "the server");
  }
};

struct Samples {
  std::vector<double> resident_bytes, threads, open_files;
};

Samples Watch(const ServerProcess& server, const Stage& stage, Clock::time_point from) {
  const std::string process = absl::StrCat(server.pid());
  Samples samples;
  for (Clock::time_point next = from; !stage.over(); next += kSamplePeriod) {
    std::this_thread::sleep_until(next);
    const auto stat = ReadProcessStat(process);
    const auto open_files = CountOpenFiles(process);
    if (!stat.has_value() || !open_files.has_value()) break;
    samples.resident_bytes.push_back(static_cast<double>(stat->resident_bytes));
    samples.threads.push_back(stat->num_threads);
    samples.open_files.push_back(*open_files);
  }
  return samples;
}

template <typename T>
void AddThreads(Stage& stage, const char* name, int number, std::uint64_t seed,
                std::vector<std::thread>& threads) {
  for (int i = 0; i < number; ++i)
    threads.emplace_back([&stage, name, i, seed] {
      T(stage, absl::StrCat(name, "_", i), seed + static_cast<std::uint64_t>(i)).Run();
    });
}

absl::Status JudgeOne(const char* what, const Growth& growth, double growth_max) {
  if (growth.growth <= growth_max) return absl::OkStatus();
  return absl::ResourceExhaustedError(
      absl::StrFormat("%s grew by %.1f over a median of %.1f, want at most %.1f", what,
                      growth.growth, growth.median, growth_max));
}

}  // namespace

absl::StatusOr<SoakReport> Soak(const ScanTape& tape, const SoakOptions& options) {
  GEM_ASSIGN_OR_RETURN(const std::unique_ptr<ServerProcess> server,
                       ServerProcess::Start(ServerFlags()));
  const Clock::time_point begin = Clock::now();
  const auto after = [&](double seconds) {
    return begin +
           std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
  };
  Stage stage(server->address(), tape, after(options.seconds));
  std::vector<std::thread> threads;
  AddThreads<SoakRobot>(stage, "robot", options.robots, options.seed, threads);
  AddThreads<SoakPlanner>(stage, "planner", options.planners, options.seed + 100, threads);
  AddThreads<SoakWatcher>(stage, "watcher", options.watchers, options.seed + 200, threads);
  AddThreads<SoakKeeper>(stage, "keeper", 1, options.seed + 300, threads);
  const Samples samples = Watch(*server, stage, after(options.warm_up_s));
  for (std::thread& thread : threads) thread.join();
  GEM_RETURN_IF_ERROR(stage.failure());
  const int exit_code = server->Stop();
  return SoakReport{
      std::chrono::duration<double>(Clock::now() - begin).count(),
      samples.threads.size(),
      stage.counts(),
      {GrowthOf(samples.resident_bytes), GrowthOf(samples.threads), GrowthOf(samples.open_files)},
      exit_code};
}

absl::Status JudgeSoak(const SoakReport& report) {
  constexpr double kShareMax = 0.05, kBytesMax = 8 << 20, kCountMax = 3;
  const Growth& memory = report.growth.resident_bytes;
  if (report.exit_code != 0)
    return absl::InternalError(absl::StrCat("the server ended with ", report.exit_code));
  if (report.num_samples < 10)
    return absl::FailedPreconditionError(
        absl::StrCat(report.num_samples, " samples after the warm-up, want at least 10"));
  GEM_RETURN_IF_ERROR(
      JudgeOne("resident memory (bytes)", memory, std::max(kBytesMax, kShareMax * memory.median)));
  GEM_RETURN_IF_ERROR(JudgeOne("the number of threads", report.growth.threads, kCountMax));
  return JudgeOne("the number of open files", report.growth.open_files, kCountMax);
}

}  // namespace gem::load
