#include "client/evaluation/drive.h"

#include <cmath>
#include <system_error>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"
#include "client/datasets/pose_file.h"
#include "client/formats/text_file.h"
#include "client/simulation/drift.h"
#include "client/simulation/path.h"
#include "core/base/status_macros.h"

namespace gem::evaluation {
namespace {

namespace fs = std::filesystem;

struct Camera;

constexpr std::int64_t kFirstStamp_ns = 1'000'000'000;  // zero looks like an unset field
constexpr double kSensorHeight_m = 1.73;
/// A pose graph puts into a few scans what odometry had gathered over a long way.
constexpr double kSpread_m = 30;

absl::StatusOr<Pose<Camera, Base>> ReadCameraFromVelodyne(const fs::path& path) {
  GEM_ASSIGN_OR_RETURN(const std::string text, ReadFile(path.string(), 1 << 20));
  for (absl::string_view line : absl::StrSplit(text, '\n')) {
    if (!absl::ConsumePrefix(&line, "Tr:")) continue;
    std::vector<double> numbers;
    for (const absl::string_view word :
         absl::StrSplit(line, absl::ByAnyChar(" \t\r"), absl::SkipEmpty()))
      if (double value = 0; ParseNumber(word, value)) numbers.push_back(value);
    if (numbers.size() != 12) break;
    GEM_ASSIGN_OR_RETURN(const RigidTransform Tr, ParsePose(path.string(), numbers.data()));
    return Tr.As<Camera, Base>();
  }
  return absl::InvalidArgumentError(
      absl::StrCat(path.string(), ": no line \"Tr:\" with 12 numbers"));
}

/// One pose a row, of the LiDAR. T_C_B: of the camera whose poses they are.
template <typename A>
absl::StatusOr<std::vector<Pose<A, Base>>> ReadPoses(const fs::path& path,
                                                     const Pose<Camera, Base>& T_C_B = {}) {
  GEM_ASSIGN_OR_RETURN(const PoseFile file, ReadPoseFile(path.string()));
  std::vector<Pose<A, Base>> poses;
  for (const RigidTransform& pose : file.poses) {
    const Pose<Base, Base> moved = T_C_B.Inverse() * pose.As<Camera, Camera>() * T_C_B;
    poses.emplace_back(moved.rotation(), moved.translation());
  }
  return poses;
}

absl::Status CheckSizes(const Drive& drive) {
  const std::size_t count = drive.size();
  if (drive.truth.size() == count && drive.odometry.size() == count &&
      drive.corrected.size() == count && count > 1)
    return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat(
      drive.name, ": ", count, " times, ", drive.truth.size(), " true poses, ",
      drive.odometry.size(), " of odometry and ", drive.corrected.size(), " corrected"));
}

/// The corrected poses as they would be, had the correction been spread over the way: C =
/// corrected * odometry^-1, averaged with a bell of sigma_m of way.
std::vector<Pose<Global, Base>> SpreadCorrection(const Drive& drive, double sigma_m) {
  std::vector<double> way_m = {0};
  for (std::size_t i = 1; i < drive.odometry.size(); ++i)
    way_m.push_back(way_m.back() +
                    (drive.odometry[i].translation() - drive.odometry[i - 1].translation()).norm());
  std::vector<Pose<Global, Odom>> corrections;
  for (std::size_t i = 0; i < drive.odometry.size(); ++i)
    corrections.push_back(drive.corrected[i] * drive.odometry[i].Inverse());
  std::vector<Pose<Global, Base>> spread;
  std::size_t first = 0;
  for (std::size_t i = 0; i < drive.odometry.size(); ++i) {
    while (way_m[i] - way_m[first] > 3 * sigma_m) ++first;
    const Point<Odom> place(drive.odometry[i].translation());
    Eigen::Vector4d rotation = Eigen::Vector4d::Zero();
    Eigen::Vector3d place_m = Eigen::Vector3d::Zero();
    double weights = 0;
    for (std::size_t k = first; k < way_m.size() && way_m[k] - way_m[i] <= 3 * sigma_m; ++k) {
      const double sigmas = (way_m[k] - way_m[i]) / sigma_m;
      const double weight = std::exp(-0.5 * sigmas * sigmas);
      const Eigen::Vector4d q = corrections[k].rotation().coeffs();
      rotation += (q.dot(rotation) < 0 ? -weight : weight) * q;
      place_m += weight * (corrections[k] * place).xyz();
      weights += weight;
    }
    spread.emplace_back(Eigen::Quaterniond(rotation).normalized() * drive.odometry[i].rotation(),
                        place_m / weights);
  }
  return spread;
}

double InventedHeight_m(const Eigen::Vector2d& p_m) {
  return 4 * std::sin(p_m.x() / 60) + 2 * std::cos(p_m.y() / 35) +
         0.15 * std::sin(p_m.x() / 7) * std::sin(p_m.y() / 9);
}

/// On a path, with odometry that drifts; the sensor leans with the way, but not sideways. The robot
/// weaves by so much to either side.
Drive DriveAlong(const Path& path, std::size_t num_scans, double spacing_m, double weave_m,
                 double drift_scale, std::uint64_t seed) {
  constexpr double kWeavePeriod_rad_per_m = 0.17;  // no round divides it
  const DriftRates rates{.forward_m_per_m = 0.004 * drift_scale,
                         .yaw_rad_per_m = 0.00001 * drift_scale,
                         .height_m_per_m = 0.003 * drift_scale,
                         .position_walk_m = 0.004 * drift_scale,
                         .yaw_walk_rad = 0.0003 * drift_scale,
                         .height_walk_m = 0.003 * drift_scale};
  Odometry odometry(rates, {}, seed);
  Drive drive;
  for (std::size_t i = 0; i < num_scans; ++i) {
    const double way_m = static_cast<double>(i) * spacing_m;
    PathPose at = path.At(std::fmod(way_m, path.length_m()));
    at.place_m += weave_m * std::sin(kWeavePeriod_rad_per_m * way_m) *
                  Eigen::Vector2d(-std::sin(at.yaw_rad), std::cos(at.yaw_rad));
    const Eigen::Vector2d ahead_m(std::cos(at.yaw_rad), std::sin(at.yaw_rad));
    const double rise =
        0.5 * (InventedHeight_m(at.place_m + ahead_m) - InventedHeight_m(at.place_m - ahead_m));
    const Eigen::Quaterniond rotation(
        Eigen::AngleAxisd(at.yaw_rad, Eigen::Vector3d::UnitZ()) *
        Eigen::AngleAxisd(-std::atan(rise), Eigen::Vector3d::UnitY()));
    drive.truth.push_back(
        {rotation,
         {at.place_m.x(), at.place_m.y(), InventedHeight_m(at.place_m) + kSensorHeight_m}});
    drive.odometry.push_back(odometry.Advance(way_m, drive.truth.back()));
    drive.stamps_ns.push_back(kFirstStamp_ns + static_cast<std::int64_t>(i) * 100'000'000);
  }
  drive.corrected = drive.truth;
  return drive;
}

}  // namespace

double LengthOf(const Drive& drive) {
  double length_m = 0;
  for (std::size_t i = 1; i < drive.size(); ++i)
    length_m += (drive.truth[i].translation() - drive.truth[i - 1].translation()).norm();
  return length_m;
}

Drive EveryNth(const Drive& drive, std::size_t n) {
  Drive thinned;
  thinned.name = drive.name;
  thinned.description = drive.description;
  for (std::size_t i = 0; i < drive.size(); i += n) {
    thinned.stamps_ns.push_back(drive.stamps_ns[i]);
    thinned.truth.push_back(drive.truth[i]);
    thinned.odometry.push_back(drive.odometry[i]);
    thinned.corrected.push_back(drive.corrected[i]);
  }
  return thinned;
}

Drive FirstOf(Drive drive, std::size_t count) {
  if (count >= drive.size()) return drive;
  drive.stamps_ns.resize(count);
  drive.truth.resize(count);
  drive.odometry.resize(count);
  drive.corrected.resize(count);
  return drive;
}

std::optional<fs::path> TrajectoriesDir(const Settings& settings) {
  if (!settings.data_dir) return std::nullopt;
  const fs::path dir = *settings.data_dir / "trajectories";
  std::error_code error;
  if (!fs::is_directory(dir, error)) return std::nullopt;
  return dir;
}

absl::StatusOr<Drive> LoadKissIcpDrive(const fs::path& trajectories) {
  Drive drive;
  drive.name = "kiss-icp";
  drive.description =
      "KITTI 00, 4,541 scans at 10 Hz: odometry of KISS-ICP, corrected by the same run's closed "
      "pose graph. That turns by up to 0.2 degrees a scan within a dozen scans about its loops and "
      "is odometry elsewhere; for the truth the correction is spread over some 60 m of way";
  const fs::path dir = trajectories / "kitti00_kissicp";
  const fs::path reference = trajectories / "kitti_gt";
  GEM_ASSIGN_OR_RETURN(const auto T_C_B, ReadCameraFromVelodyne(reference / "calib_00.txt"));
  GEM_ASSIGN_OR_RETURN(drive.odometry, ReadPoses<Odom>(dir / "00_odometry.txt", T_C_B));
  GEM_ASSIGN_OR_RETURN(drive.corrected, ReadPoses<Global>(dir / "00_loop_closed.txt", T_C_B));
  GEM_ASSIGN_OR_RETURN(TimesFile times, ReadTimesFile((reference / "times_00.txt").string()));
  drive.stamps_ns = std::move(times.stamps_ns);
  for (std::int64_t& stamp_ns : drive.stamps_ns) stamp_ns += kFirstStamp_ns;
  drive.truth = drive.corrected;
  GEM_RETURN_IF_ERROR(CheckSizes(drive));
  drive.truth = SpreadCorrection(drive, kSpread_m);
  return drive;
}

absl::StatusOr<Drive> LoadKinkedKissIcpDrive(const fs::path& trajectories) {
  GEM_ASSIGN_OR_RETURN(Drive drive, LoadKissIcpDrive(trajectories));
  drive.name = "kiss-icp-kinked";
  drive.description =
      "the same, but the closed pose graph is the truth as it was published: a car that turns by "
      "0.2 degrees between scans, and odometry that does not see it";
  drive.truth = drive.corrected;
  return drive;
}

absl::StatusOr<Drive> LoadOrbDrive(const fs::path& trajectories) {
  GEM_ASSIGN_OR_RETURN(Drive drive, LoadKissIcpDrive(trajectories));
  drive.name = "orb";
  drive.description =
      "the same scans, with the trajectory of ORB-SLAM (cameras) as odometry; truth and correction "
      "as for kiss-icp";
  GEM_ASSIGN_OR_RETURN(const auto T_C_B,
                       ReadCameraFromVelodyne(trajectories / "kitti_gt" / "calib_00.txt"));
  GEM_ASSIGN_OR_RETURN(drive.odometry,
                       ReadPoses<Odom>(trajectories / "kitti00_evo" / "KITTI_00_ORB.txt", T_C_B));
  GEM_RETURN_IF_ERROR(CheckSizes(drive));
  return drive;
}

absl::StatusOr<Drive> LoadNdtDrive(const fs::path& trajectories) {
  // Not in the files: 1,906 key scans over the 470.6 s of KITTI 00.
  constexpr std::int64_t kPeriod_ns = 247'000'000;
  const fs::path dir = trajectories / "kitti00_ndt_g2o";
  Drive drive;
  drive.name = "ndt";
  drive.description =
      "KITTI 00, 1,906 key scans 2 m apart: odometry of an NDT front end, corrected by g2o with "
      "loops and GNSS; the true place is RTK's, the true attitude g2o's";
  GEM_ASSIGN_OR_RETURN(drive.odometry, ReadPoses<Odom>(dir / "laser_odom.txt"));
  GEM_ASSIGN_OR_RETURN(drive.corrected, ReadPoses<Global>(dir / "optimized.txt"));
  GEM_ASSIGN_OR_RETURN(drive.truth, ReadPoses<Global>(dir / "ground_truth.txt"));
  for (std::size_t i = 0; i < drive.truth.size(); ++i)
    drive.stamps_ns.push_back(kFirstStamp_ns + static_cast<std::int64_t>(i) * kPeriod_ns);
  GEM_RETURN_IF_ERROR(CheckSizes(drive));
  for (std::size_t i = 0; i < drive.size(); ++i)
    drive.truth[i] = {drive.corrected[i].rotation(), drive.truth[i].translation()};
  return drive;
}

Drive InventedDrive(std::size_t scans_max, double drift_scale, std::uint64_t seed) {
  constexpr double kSpacing_m = 0.82;  // KITTI 00's mean at 10 Hz
  const Path path({{0, 0},
                   {240, 0},
                   {240, 160},
                   {0, 160},
                   {0, 0},
                   {120, 0},
                   {120, 160},
                   {240, 160},
                   {240, -90},
                   {0, -90},
                   {0, 160},
                   {120, 160},
                   {120, -90},
                   {240, -90},
                   {240, 160},
                   {-110, 160},
                   {-110, 0},
                   {200, 0}},
                  8.0);
  const auto whole = static_cast<std::size_t>(path.length_m() / kSpacing_m);
  Drive drive = DriveAlong(path, std::min(whole, scans_max), kSpacing_m, 0, drift_scale, seed);
  drive.name = "invented";
  drive.description =
      "streets round some blocks, in parts driven twice, with invented drift; the correction is "
      "the truth";
  return drive;
}

Drive RoundTheBlock(std::size_t num_scans, double scan_spacing_m, double drift_scale,
                    std::uint64_t seed) {
  // Closed: it ends where and as it begins.
  const Path path({{30, 0}, {60, 0}, {60, 40}, {0, 40}, {0, 0}, {30, 0}}, 6.0);
  Drive drive = DriveAlong(path, num_scans, scan_spacing_m, 0.4, drift_scale, seed);
  drive.name = "block";
  drive.description =
      "round a block of 60 x 40 m again and again, weaving by 0.4 m, with invented drift; the "
      "correction is the truth";
  return drive;
}

}  // namespace gem::evaluation
