#include "client/evaluation/any_slam.h"

#include <algorithm>
#include <chrono>
#include <memory>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/connection.h"
#include "client/evaluation/revisits.h"
#include "client/evaluation/road_truth.h"
#include "client/evaluation/town_drive.h"
#include "client/ingest_client.h"
#include "client/load/server_process.h"
#include "client/map_client.h"
#include "core/base/status_macros.h"

namespace gem::evaluation {
namespace {

constexpr char kSensor[] = "lidar";
constexpr int kAzimuths = 300;
constexpr std::size_t kEvery = 3;  // of the scans at 10 Hz: 2.5 m apart

struct MapQuality {
  Deviation road;  ///< free cells within 2 m of the way less the town's ground
  std::uint64_t num_submaps = 0;
};

struct Findings {
  std::string name;
  std::size_t num_scans = 0;
  double length_m = 0;
  std::size_t num_corrections = 0;
  std::uint64_t num_refused = 0;
  double correction_s_max = 0;
  MapQuality corrected;
  MapQuality from_start;  ///< another session, which is given the corrected poses
};

Deviation RoadError(const client::TiledMap& map, const RoadTruth& truth) {
  std::vector<double> differences_m;
  for (const client::MapTile& tile : map.tiles.tiles) {
    if (!tile.grid) continue;
    const GridLayer* elevation = tile.grid->Find(Layer::kElevation);
    const GridLayer* traversability = tile.grid->Find(Layer::kTraversability);
    if (elevation == nullptr || traversability == nullptr) continue;
    const CellIndex origin = OriginOf(tile.index);
    for (std::size_t i = 0; i < elevation->values.size(); ++i) {
      if (elevation->valid[i] == 0 || traversability->valid[i] == 0 ||
          traversability->values[i] <= map.matrix.traversability_free)
        continue;
      const auto offset = static_cast<std::int32_t>(i);
      const double x_m = CenterOf(origin.x + offset % kTileCells, map.matrix.cell_size_m);
      const double y_m = CenterOf(origin.y + offset / kTileCells, map.matrix.cell_size_m);
      if (const auto height_m = truth(x_m, y_m))
        differences_m.push_back(elevation->values[i] - *height_m);
    }
  }
  return DeviationOf(std::move(differences_m));
}

/// One drive through one server: a robot that is told odometry and corrected at its loops, and one
/// that is told the corrected poses.
class ServedDrive {
 public:
  ServedDrive(const TownDrive& town, std::shared_ptr<const client::Connection> connection)
      : town_(town), connection_(std::move(connection)), maps_(connection_) {}

  absl::StatusOr<Findings> Run(const Settings& settings, double begin, double share) {
    const Drive& drive = town_.drive;
    findings_.name = drive.name;
    findings_.num_scans = drive.size();
    findings_.length_m = LengthOf(drive);
    const Pose<Global, Odom> T_G_O = drive.corrected.front() * drive.odometry.front().Inverse();
    GEM_ASSIGN_OR_RETURN(robot_, Open(drive.name, T_G_O));
    GEM_ASSIGN_OR_RETURN(reference_, Open(ReferenceMap(), {}));
    const std::vector<std::size_t> closures =
        LoopClosures(drive.truth, drive.stamps_ns, {.scans_between = 50});
    absl::Status status;
    CastScans(town_,
              {.lidar = TownLidar(kAzimuths), .threads = settings.threads, .seed = settings.seed},
              [&](std::size_t i, std::span<const ScanPoint> points) {
                if (status.ok()) status = Send(i, points);
                if (status.ok() && std::binary_search(closures.begin(), closures.end(), i))
                  status = Correct(i + 1);
                if (i % 64 == 0)
                  settings.progress(drive.name, begin + share * static_cast<double>(i) /
                                                            static_cast<double>(drive.size()));
              });
    GEM_RETURN_IF_ERROR(status);
    GEM_RETURN_IF_ERROR(Finish());
    return findings_;
  }

 private:
  std::string ReferenceMap() const { return town_.drive.name + "_from_start"; }

  /// Only who and where: everything else is the server's default, and the same for all.
  absl::StatusOr<std::unique_ptr<client::IngestClient>> Open(const std::string& map,
                                                             const Pose<Global, Odom>& T_G_O) {
    GEM_ASSIGN_OR_RETURN(const NoiseModel noise, MakeNoiseModel(LidarNoise{}));
    client::SessionSetup setup;
    setup.map = map;
    setup.robot = map;
    setup.session = map;
    setup.T_G_O = T_G_O;
    setup.sensors = {{kSensor, {}, noise}};
    return client::IngestClient::Open(connection_, setup);
  }

  absl::Status Send(std::size_t i, std::span<const ScanPoint> points) {
    const Drive& drive = town_.drive;
    const Pose<Global, Base>& corrected = drive.corrected[i];
    GEM_RETURN_IF_ERROR(
        robot_->Send({drive.stamps_ns[i], kSensor, drive.odometry[i], std::nullopt, points}));
    return reference_->Send({drive.stamps_ns[i], kSensor,
                             Pose<Odom, Base>(corrected.rotation(), corrected.translation()),
                             std::nullopt, points});
  }

  absl::Status Correct(std::size_t count) {
    GEM_RETURN_IF_ERROR(robot_->WaitUntilFused());
    client::Correction correction{town_.drive.name, town_.drive.name, "", {}};
    for (std::size_t i = 0; i < count; ++i)
      correction.poses.push_back({town_.drive.stamps_ns[i], town_.drive.corrected[i]});
    const auto begin = std::chrono::steady_clock::now();
    const auto result = maps_.CorrectTrajectory(correction);
    const std::chrono::duration<double> elapsed = std::chrono::steady_clock::now() - begin;
    findings_.correction_s_max = std::max(findings_.correction_s_max, elapsed.count());
    ++findings_.num_corrections;
    return result.status();
  }

  absl::Status Finish() {
    GEM_RETURN_IF_ERROR(Correct(town_.drive.size()));
    GEM_ASSIGN_OR_RETURN(const client::SessionClosed closed, robot_->Close());
    GEM_ASSIGN_OR_RETURN(const client::SessionClosed reference, reference_->Close());
    findings_.num_refused = closed.num_scans_refused + reference.num_scans_refused;
    GEM_ASSIGN_OR_RETURN(findings_.corrected, Look(town_.drive.name));
    GEM_ASSIGN_OR_RETURN(findings_.from_start, Look(ReferenceMap()));
    return absl::OkStatus();
  }

  absl::StatusOr<MapQuality> Look(const std::string& map) {
    GEM_ASSIGN_OR_RETURN(const client::MapInfo info, maps_.GetMap(map));
    GEM_ASSIGN_OR_RETURN(
        const client::TiledMap tiles,
        maps_.ReadMap(map, std::nullopt, {.layers = {Layer::kElevation, Layer::kTraversability}}));
    return MapQuality{RoadError(tiles, RoadTruth(town_)), info.num_submaps};
  }

  const TownDrive& town_;
  const std::shared_ptr<const client::Connection> connection_;
  const client::MapClient maps_;
  std::unique_ptr<client::IngestClient> robot_;
  std::unique_ptr<client::IngestClient> reference_;
  Findings findings_;
};

absl::StatusOr<std::vector<Drive>> Drives(const Settings& settings, Report& report) {
  std::vector<Drive> drives;
  if (const auto dir = TrajectoriesDir(settings)) {
    GEM_ASSIGN_OR_RETURN(const Drive orb, LoadOrbDrive(*dir));
    GEM_ASSIGN_OR_RETURN(const Drive kiss, LoadKissIcpDrive(*dir));
    GEM_ASSIGN_OR_RETURN(Drive ndt, LoadNdtDrive(*dir));
    drives = {EveryNth(orb, kEvery), EveryNth(kiss, kEvery), std::move(ndt)};
  } else {
    report.skipped.push_back("trajectories of KITTI 00: no `trajectories` in --data");
    for (const double drift_scale : {0.5, 2.0}) {
      Drive drive = EveryNth(InventedDrive(4541, drift_scale, settings.seed), kEvery);
      drive.name = absl::StrFormat("drift_%g", drift_scale);
      drives.push_back(std::move(drive));
    }
  }
  for (Drive& drive : drives) {
    const auto count = static_cast<std::size_t>(settings.scale * static_cast<double>(drive.size()));
    drive = FirstOf(std::move(drive), std::max<std::size_t>(count, 50));
  }
  return drives;
}

void AddFindings(const Findings& findings, Report& report) {
  const auto cm = [](double metres) { return absl::StrFormat("%.1f", 100 * metres); };
  report.tables.front().rows.push_back(
      {findings.name, absl::StrCat(findings.num_scans),
       absl::StrFormat("%.2f", findings.length_m / 1000), absl::StrCat(findings.num_corrections),
       absl::StrFormat("%.0f", 1e3 * findings.correction_s_max),
       absl::StrCat(findings.corrected.num_submaps), cm(findings.corrected.road.rms_m),
       cm(findings.corrected.road.median_m), cm(findings.from_start.road.rms_m),
       cm(findings.from_start.road.median_m)});
  report.figures.push_back({.name = absl::StrCat(findings.name, ": road error, median"),
                            .value = 100 * findings.corrected.road.median_m,
                            .unit = "cm"});
  report.figures.push_back(
      {.name = absl::StrCat(findings.name, ": the same, built from its corrected poses"),
       .value = 100 * findings.from_start.road.median_m,
       .unit = "cm"});
  report.figures.push_back({.name = absl::StrCat(findings.name, ": scans refused"),
                            .value = static_cast<double>(findings.num_refused),
                            .at_most = 0});
}

}  // namespace

absl::StatusOr<Report> RunAnySlam(const Settings& settings) {
  Report report;
  report.name = "any_slam";
  report.title = "One server, three SLAM systems";
  auto server = load::ServerProcess::Start();
  if (absl::IsNotFound(server.status())) {
    report.skipped.push_back("everything: there is no gem_server beside gem");
    return report;
  }
  GEM_RETURN_IF_ERROR(server.status());
  const auto connection = std::make_shared<const client::Connection>(
      client::ConnectionOptions{.address = (*server)->address()});
  GEM_ASSIGN_OR_RETURN(const std::vector<Drive> drives, Drives(settings, report));
  Table table{.title = "Maps read back from the server"};
  table.columns = {"SLAM",
                   "scans",
                   "km",
                   "corrections",
                   "longest correction, ms",
                   "submaps",
                   "road: rms error, cm",
                   "median, cm",
                   "from corrected poses: rms, cm",
                   "median, cm"};
  report.tables = {std::move(table)};
  std::string which;
  for (std::size_t i = 0; i < drives.size(); ++i) {
    const TownDrive town = BuildTownDrive(drives[i], settings.seed);
    const double share = 1.0 / static_cast<double>(drives.size());
    GEM_ASSIGN_OR_RETURN(
        const Findings findings,
        ServedDrive(town, connection).Run(settings, static_cast<double>(i) * share, share));
    AddFindings(findings, report);
    absl::StrAppend(&which, "\n- **", drives[i].name, "**: ", drives[i].description, ".");
  }
  report.method = absl::StrCat(
      "A gem_server of its own, with its defaults. Scans (64 x ", kAzimuths,
      " beams) are cast in a town and streamed to it over gRPC, ", kEvery,
      " times fewer than recorded where there are 10 a second; the map is corrected at every loop "
      "and at the end, then its tiles are fetched and held against the town's ground: free cells "
      "within 2 m of the way. Beside it a second session is told the corrected poses from the "
      "start. Nothing but the names differs between the three.\n",
      which);
  return report;
}

}  // namespace gem::evaluation
