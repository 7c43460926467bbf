#include "client/simulation/scenes.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "client/simulation/ray_caster.h"

namespace gem {
namespace {

using ::testing::HasSubstr;

/// A file of 41 x 41 heights of 2 m cells, a gentle valley; gone with the object.
class TerrainFile {
 public:
  TerrainFile() : path_(std::filesystem::temp_directory_path() / "gem_scenes_test_valley.asc") {
    std::ofstream file(path_);
    file << "ncols 41\nnrows 41\nxllcorner 100\nyllcorner -50\ncellsize 2\n";
    for (int row = 0; row < 41; ++row) {
      for (int column = 0; column < 41; ++column) file << std::abs(column - 20) * 0.1 << ' ';
      file << '\n';
    }
  }
  ~TerrainFile() { std::filesystem::remove(path_); }
  std::string path() const { return path_.string(); }

 private:
  std::filesystem::path path_;
};

/// Small enough to run in milliseconds.
SceneOptions Small(const std::string& name, const TerrainFile& terrain) {
  SceneOptions options;
  options.name = name;
  options.rings = 16;
  options.azimuths = 90;
  if (name == "terrain") options.terrain_file = terrain.path();
  return options;
}

std::vector<SourceScan> AllScans(ScanSource& source) {
  std::vector<SourceScan> scans;
  SourceScan scan;
  while (source.Next(scan).value()) scans.push_back(scan);
  return scans;
}

bool SameBytes(const std::vector<SourceScan>& a, const std::vector<SourceScan>& b) {
  return std::equal(
      a.begin(), a.end(), b.begin(), b.end(), [](const SourceScan& x, const SourceScan& y) {
        return x.stamp_ns == y.stamp_ns && x.T_O_B.translation() == y.T_O_B.translation() &&
               x.points.size() == y.points.size() &&
               std::memcmp(x.points.data(), y.points.data(), x.points.size() * sizeof(ScanPoint)) ==
                   0;
      });
}

class EveryScene : public ::testing::TestWithParam<std::string> {
 protected:
  TerrainFile terrain_;
};

TEST_P(EveryScene, GivesScansInOrderWhosePointsLieWithinRange) {
  auto source = MakeScene(Small(GetParam(), terrain_));
  ASSERT_TRUE(source.ok()) << source.status();
  const std::vector<SourceScan> scans = AllScans(**source);
  ASSERT_EQ(scans.size(), (*source)->num_scans());
  ASSERT_GE(scans.size(), 40u);
  const LidarOptions& lidar = (*source)->lidar().options();
  std::int64_t last_ns = 0;
  for (const SourceScan& scan : scans) {
    EXPECT_GT(scan.stamp_ns, last_ns);
    last_ns = scan.stamp_ns;
    // 16 x 90 beams, of which some look at the sky.
    EXPECT_GT(scan.points.size(), 16u * 90u / 2);
    for (const ScanPoint& p : scan.points) {
      const double range_m = std::hypot(p.x_m, p.y_m, p.z_m);
      ASSERT_GE(range_m, lidar.range_m_min - 1e-4);
      ASSERT_LE(range_m, lidar.range_m_max + 1e-4);
    }
  }
}

TEST_P(EveryScene, OdometryAndTruthStartAlike) {
  auto source = MakeScene(Small(GetParam(), terrain_));
  ASSERT_TRUE(source.ok()) << source.status();
  const SimulatedPose& first = (*source)->poses().front();
  EXPECT_EQ(first.T_O_B.translation(), first.T_G_B.translation());
  EXPECT_EQ(first.T_O_B.rotation().coeffs(), first.T_G_B.rotation().coeffs());
}

TEST_P(EveryScene, WithoutDriftOdometryIsTheTruth) {
  SceneOptions options = Small(GetParam(), terrain_);
  options.drift_scale = 0;
  auto source = MakeScene(options);
  ASSERT_TRUE(source.ok()) << source.status();
  for (const SimulatedPose& pose : (*source)->poses())
    ASSERT_EQ(pose.T_O_B.translation(), pose.T_G_B.translation());
}

TEST_P(EveryScene, IsTheSameForTheSameSeedAndAnotherForAnother) {
  SceneOptions options = Small(GetParam(), terrain_);
  options.scans_max = 10;
  const std::vector<SourceScan> scans = AllScans(**MakeScene(options));
  ASSERT_EQ(scans.size(), 10u);
  EXPECT_TRUE(SameBytes(scans, AllScans(**MakeScene(options))));
  options.seed = 2;
  EXPECT_FALSE(SameBytes(scans, AllScans(**MakeScene(options))));
}

// Straight down beside the robot, ray and true height must tell the same.
TEST_P(EveryScene, RaysFromAboveMeetTheTrueHeight) {
  auto source = MakeScene(Small(GetParam(), terrain_));
  ASSERT_TRUE(source.ok()) << source.status();
  const World& world = (*source)->world();
  int compared = 0;
  for (std::size_t i = 0; i < (*source)->poses().size(); i += 10) {
    const Eigen::Vector3d base_m = (*source)->poses()[i].T_G_B.translation();
    for (int k = 0; k < 40; ++k) {
      // From above no walker's head.
      const Eigen::Vector3d from_m = base_m + Eigen::Vector3d(0.31 * k - 6, 0.17 * k * k - 9, 20);
      const auto hit = world.Cast({from_m, -Eigen::Vector3d::UnitZ()}, 60, 0);
      if (!hit || hit->kind == HitKind::kWalker) continue;
      ++compared;
      EXPECT_NEAR(from_m.z() - hit->range_m, *world.TrueHeightAt(from_m.x(), from_m.y()), 1e-6);
    }
  }
  EXPECT_GT(compared, 50);
}

TEST_P(EveryScene, EveryPointOfAnExactScanIsOnTheGroundOrOnASolid) {
  SceneOptions options = Small(GetParam(), terrain_);
  options.noise_scale = 0;
  options.scans_max = 5;
  auto source = MakeScene(options);
  ASSERT_TRUE(source.ok()) << source.status();
  const Pose<Base, Sensor> T_B_S = (*source)->T_B_S();
  SourceScan scan;
  while ((*source)->Next(scan).value()) {
    const Pose<Global, Sensor> T_G_S = *scan.T_G_B * T_B_S;
    for (const ScanPoint& p : scan.points) {
      const Eigen::Vector3d p_S(p.x_m, p.y_m, p.z_m);
      const Eigen::Vector3d direction = (T_G_S.rotation() * p_S).normalized();
      const auto hit = (*source)->world().Cast({T_G_S.translation(), direction}, 100,
                                               SimulatedSource::WorldTime(scan.stamp_ns));
      ASSERT_TRUE(hit);
      // Float rounds the direction: 1e-7 rad, which at grazing incidence moves the hit.
      if (std::abs(direction.z()) < 0.05) continue;
      EXPECT_NEAR(hit->range_m, p_S.norm(), 1e-3);
    }
  }
}

std::vector<std::string> SceneNames() {
  std::vector<std::string> names;
  for (const SceneInfo& scene : SceneList()) names.push_back(scene.name);
  return names;
}

INSTANTIATE_TEST_SUITE_P(Scenes, EveryScene, ::testing::ValuesIn(SceneNames()),
                         [](const auto& scene) { return scene.param; });

absl::Status Refusal(const SceneOptions& options) { return MakeScene(options).status(); }

TEST(SceneOptions, UnknownSceneIsAnsweredWithTheKnownOnes) {
  const absl::Status status = Refusal({.name = "moon"});
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(status.message(),
            "scene.name is \"moon\", want one of block, flat, cubes, crowd, segments, terrain");
}

TEST(SceneOptions, ValuesOutsideTheirRangeAreRefusedByName) {
  EXPECT_EQ(Refusal({.rings = 0}).message(), "scene.rings is 0, want [1, 256]");
  EXPECT_EQ(Refusal({.azimuths = 9000}).message(), "scene.azimuths is 9000, want [8, 8192]");
  EXPECT_EQ(Refusal({.scans_max = -1}).message(), "scene.scans_max is -1, want [0, 1000000]");
  EXPECT_EQ(Refusal({.scan_spacing_m = -0.5}).message(),
            "scene.scan_spacing_m is -0.5, want [0, 10]");
  EXPECT_EQ(Refusal({.drift_scale = std::nan("")}).message(),
            "scene.drift_scale is nan, want [0, 100]");
  EXPECT_EQ(Refusal({.noise_scale = 21}).message(), "scene.noise_scale is 21, want [0, 20]");
}

TEST(SceneOptions, TerrainFileIsForTheSceneThatNeedsIt) {
  EXPECT_THAT(std::string(Refusal({.name = "terrain"}).message()),
              HasSubstr("scene.terrain_file is empty"));
  EXPECT_THAT(std::string(Refusal({.name = "flat", .terrain_file = "dem.asc"}).message()),
              HasSubstr("want none for scene flat"));
  EXPECT_THAT(
      std::string(Refusal({.name = "terrain", .terrain_file = "no/such/dem.asc"}).message()),
      HasSubstr("no/such/dem.asc"));
}

TEST(SceneOptions, SpacingOfZeroLetsTheRobotStand) {
  auto source = MakeScene({.name = "cubes", .scans_max = 7, .scan_spacing_m = 0});
  ASSERT_TRUE(source.ok()) << source.status();
  ASSERT_EQ((*source)->num_scans(), 7u);
  EXPECT_EQ((*source)->poses().back().T_G_B.translation(),
            (*source)->poses().front().T_G_B.translation());
}

TEST(Block, ClosesItsLoopAndOdometryDoesNot) {
  auto source = MakeScene({});
  ASSERT_TRUE(source.ok()) << source.status();
  const std::vector<SimulatedPose>& poses = (*source)->poses();
  EXPECT_GT(poses.size(), 400u);
  EXPECT_LT(poses.size(), 600u);
  // The last 25 m lie on the first 25.
  const Eigen::Vector3d end_m = poses.back().T_G_B.translation();
  EXPECT_NEAR(end_m.x(), poses.front().T_G_B.translation().x() + 25, 0.5);
  EXPECT_NEAR(end_m.y(), poses.front().T_G_B.translation().y(), 1e-9);
  // And odometry says that they are some metres off.
  const Eigen::Vector3d error_m = poses.back().T_O_B.translation() - end_m;
  EXPECT_GT(error_m.head<2>().norm(), 1.5);
  EXPECT_LT(error_m.head<2>().norm(), 6.0);
  EXPECT_GT(std::abs(error_m.z()), 0.3);
}

TEST(Block, RobotKeepsClearOfSolidsAndWalkers) {
  auto source = MakeScene({});
  ASSERT_TRUE(source.ok()) << source.status();
  const World& world = (*source)->world();
  for (const SimulatedPose& pose : (*source)->poses()) {
    const Eigen::Vector3d sensor_m = (pose.T_G_B * (*source)->T_B_S()).translation();
    const double time_s = SimulatedSource::WorldTime(pose.stamp_ns);
    for (int i = 0; i < 36; ++i) {
      const double yaw_rad = i * M_PI / 18;
      const auto hit = world.Cast(
          {sensor_m - Eigen::Vector3d(0, 0, 1.4), {std::cos(yaw_rad), std::sin(yaw_rad), 0}}, 1.2,
          time_s);
      EXPECT_TRUE(!hit || hit->kind == HitKind::kGround) << pose.way_m;
    }
  }
}

TEST(Block, PedestrianCrossesTheStreetInSightOfTheRobot) {
  auto source = MakeScene({.rings = 32, .azimuths = 256});
  ASSERT_TRUE(source.ok()) << source.status();
  const World& world = (*source)->world();
  int crossing_scans = 0;
  for (const SimulatedPose& pose : (*source)->poses()) {
    const double time_s = SimulatedSource::WorldTime(pose.stamp_ns);
    const Eigen::Vector2d place_m = world.WalkerAt(0, time_s).center_m;
    const double distance_m = (place_m - pose.T_G_B.translation().head<2>()).norm();
    EXPECT_GT(distance_m, 2.0);
    crossing_scans += place_m.y() > 36 && place_m.y() < 44 && distance_m < 12;
  }
  EXPECT_GE(crossing_scans, 15);
}

TEST(Segments, OdometryIsExactBetweenJumpsOfWholeCells) {
  auto source = MakeScene({.name = "segments"});
  ASSERT_TRUE(source.ok()) << source.status();
  const std::vector<SimulatedPose>& poses = (*source)->poses();
  int jumps = 0;
  for (std::size_t i = 1; i < poses.size(); ++i) {
    const auto error_m = [&](std::size_t k) -> Eigen::Vector3d {
      return poses[k].T_O_B.translation() - poses[k].T_G_B.translation();
    };
    const Eigen::Vector3d jump_m = error_m(i) - error_m(i - 1);
    EXPECT_LT(poses[i].T_O_B.rotation().angularDistance(poses[i].T_G_B.rotation()), 1e-7);
    if (jump_m.norm() < 1e-9) continue;
    ++jumps;
    for (const double cell_size_m : {0.1, 0.2, 0.3, 0.4}) {
      for (const int axis : {0, 1}) {
        const double cells = jump_m[axis] / cell_size_m;
        EXPECT_GT(std::abs(cells), 2.0);
        EXPECT_NEAR(cells, std::round(cells), 1e-9);
      }
    }
    // Nothing was seen for longer than a local map is wide, and a submap of 20 m has ended.
    EXPECT_GT(poses[i].way_m - poses[i - 1].way_m, 8.0 * std::sqrt(2.0));
    EXPECT_GT(poses[i].way_m, 20.0 * jumps);
  }
  EXPECT_EQ(jumps, 5);
}

TEST(Crowd, ThirtyWalkersKeepOutOfTheRobotsWay) {
  auto source = MakeScene({.name = "crowd"});
  ASSERT_TRUE(source.ok()) << source.status();
  ASSERT_EQ((*source)->world().walkers().size(), 30u);
  for (const SimulatedPose& pose : (*source)->poses()) {
    for (std::size_t i = 0; i < 30; ++i) {
      const Cylinder body =
          (*source)->world().WalkerAt(i, SimulatedSource::WorldTime(pose.stamp_ns));
      EXPECT_GE((body.center_m - pose.T_G_B.translation().head<2>()).norm(), 1.0 - 1e-6);
    }
  }
}

TEST(Cubes, SixOfHalfAMetreLieInTheLocalMap) {
  auto source = MakeScene({.name = "cubes"});
  ASSERT_TRUE(source.ok()) << source.status();
  const World& world = (*source)->world();
  ASSERT_EQ(world.boxes().size(), 6u);
  for (const Box& cube : world.boxes()) {
    EXPECT_EQ(*world.TrueHeightAt(cube.center_m.x(), cube.center_m.y()), 0.5);
    EXPECT_LT(cube.center_m.cwiseAbs().maxCoeff(), 3.5);
  }
}

// Not a test of time: says how long the demo's simulator takes.
TEST(Block, ReportsItsSpeed) {
  auto source = MakeScene({.scans_max = 20});
  ASSERT_TRUE(source.ok()) << source.status();
  const auto start = std::chrono::steady_clock::now();
  const std::size_t num_scans = AllScans(**source).size();
  const double seconds =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  std::printf("block: %.1f scans/s, %.2f M rays/s on one core\n",
              static_cast<double>(num_scans) / seconds,
              static_cast<double>(num_scans) * 64 * 1024 / seconds * 1e-6);
  EXPECT_EQ(num_scans, 20u);
}

}  // namespace
}  // namespace gem
