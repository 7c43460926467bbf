#include "client/simulation/scene_builders.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/str_format.h"
#include "client/formats/esri_ascii.h"
#include "client/simulation/analytic_terrain.h"
#include "client/simulation/grid_terrain.h"
#include "client/simulation/random.h"
#include "core/base/status_macros.h"

namespace gem {
namespace {

constexpr std::size_t kStandingScans = 40;

std::unique_ptr<World> FlatWorld() {
  return std::make_unique<World>(
      std::make_unique<AnalyticTerrain>(GroundPlane{}, std::vector<Hill>{}, std::vector<Step>{}));
}

}  // namespace

DriftRates DriftRatesOf(double scale) {
  return {.forward_m_per_m = 0.006 * scale,
          .yaw_rad_per_m = 0.0009 * scale,
          .height_m_per_m = 0.003 * scale,
          .position_walk_m = 0.006 * scale,
          .yaw_walk_rad = 0.0006 * scale,
          .height_walk_m = 0.004 * scale};
}

Simulation SimulationOn(Path path, double scan_spacing_m, const SceneOptions& options) {
  Simulation simulation(std::move(path));
  simulation.name = options.name;
  simulation.seed = options.seed;
  simulation.lidar.rings = options.rings;
  simulation.lidar.azimuths = options.azimuths;
  simulation.lidar.sigma_range_m *= options.noise_scale;
  simulation.lidar.dropout *= options.noise_scale;
  const double spacing_m = options.scan_spacing_m.value_or(scan_spacing_m);
  simulation.robot.scan_spacing_m = spacing_m;
  const auto scans_max = static_cast<std::size_t>(options.scans_max);
  if (spacing_m == 0) {
    simulation.num_steps = scans_max == 0 ? kStandingScans : scans_max;
    return simulation;
  }
  // Rounding must not cost the last scan of a path that the spacing divides.
  const double steps = std::min(std::floor(simulation.path.length_m() / spacing_m + 1e-9), 1e6);
  simulation.num_steps = static_cast<std::size_t>(steps) + 1;
  if (scans_max > 0) simulation.num_steps = std::min(simulation.num_steps, scans_max);
  return simulation;
}

Simulation BuildFlat(const SceneOptions& options) {
  Simulation simulation = SimulationOn(Path({{0, 0}, {50, 0}}, 0), 0.45, options);
  simulation.world = FlatWorld();
  simulation.drift = DriftRatesOf(options.drift_scale);
  return simulation;
}

Simulation BuildCubes(const SceneOptions& options) {
  Simulation simulation = SimulationOn(Path({{-0.5, 0}, {0.5, 0}}, 0), 0.025, options);
  // Low enough that the lowest beams see the ground before the cubes, high enough that several
  // rings see their tops.
  simulation.robot.sensor_height_m = 1.2;
  auto world = FlatWorld();
  const Eigen::Vector2d centers_m[] = {{2.63, 1.47},   {0.08, 3.05},   {-2.71, 1.62},
                                       {-2.57, -1.55}, {-0.11, -3.12}, {2.74, -1.63}};
  double yaw_rad = 0.1;
  for (const Eigen::Vector2d& center_m : centers_m) {
    world->Add(MakeBox(center_m, {0.5, 0.5}, yaw_rad, 0.0, 0.5));
    yaw_rad += 0.25;
  }
  simulation.world = std::move(world);
  return simulation;
}

namespace {

/// True if the walker comes nearer than a metre to the robot while the simulation lasts.
bool MeetsRobot(const Walker& walker, const Simulation& simulation) {
  for (std::size_t step = 0; step < simulation.num_steps; ++step) {
    const auto s = static_cast<double>(step);
    const Eigen::Vector2d robot_m = simulation.path.At(s * simulation.robot.scan_spacing_m).place_m;
    if ((walker.At(s * simulation.robot.scan_period_s) - robot_m).norm() < 1.0) return true;
  }
  return false;
}

}  // namespace

Simulation BuildCrowd(const SceneOptions& options) {
  constexpr std::size_t kWalkers = 30;
  Simulation simulation = SimulationOn(Path({{-10, 0}, {10, 0}}, 0), 0.1, options);
  auto world = FlatWorld();
  Random random(options.seed, /*stream=*/~std::uint64_t{1});
  const auto place_m = [&] {
    const double x_m = 28 * random.Uniform() - 14;
    return Eigen::Vector2d(x_m, 16 * random.Uniform() - 8);
  };
  // Nobody walks into the robot. Bounded: whoever cannot avoid it in a thousand tries stays away.
  for (int tries = 0; tries < 1000 && world->walkers().size() < kWalkers; ++tries) {
    Walker walker;
    for (int i = 0; i < 4; ++i) walker.path_m.push_back(place_m());
    walker.speed_m_per_s = 0.8 + 0.8 * random.Uniform();
    walker.start_m = 40 * random.Uniform();
    if (!MeetsRobot(walker, simulation)) world->Add(std::move(walker));
  }
  simulation.world = std::move(world);
  return simulation;
}

Simulation BuildSegments(const SceneOptions& options) {
  // Longer than a submap of 20 m, so that each jump falls between two; the sensor is silent before
  // it for longer than a local map of 8 m, so that no local map sees both sides of it.
  constexpr double kSegment_m = 20.5;
  constexpr double kSilence_m = 12.0;
  // Whole cells of 0.1, 0.2, 0.3 and 0.4 m.
  constexpr double kJump_m = 1.2;
  // Never on a border of cells: there a hair of rounding decides which window the robot has.
  constexpr double kAside_m = 0.03;
  Simulation simulation =
      SimulationOn(Path({{kAside_m, kAside_m}, {110 + kAside_m, kAside_m}}, 0), 0.5, options);
  const std::vector<Hill> hills = {{6, 5, 4, 0.8},   {28, -6, 5, 1.0}, {45, 6, 5, 1.2},
                                   {66, -5, 4, 0.7}, {87, 5, 4, 0.9},  {107, -6, 5, 1.1}};
  auto world = std::make_unique<World>(
      std::make_unique<AnalyticTerrain>(GroundPlane{}, hills, std::vector<Step>{}));
  for (int i = 0; i <= 5; ++i) {
    const double x_m = kSegment_m * i;
    world->Add(MakeBox({x_m + 4.37, -2.41}, {0.5, 0.5}, 0.3, 0.0, 0.5));
    world->Add(MakeWall({x_m + 0.7, 3.13}, {x_m + 3.6, 3.43}, 0.2, 0.0, 1.2));
  }
  simulation.world = std::move(world);
  const double steps = std::round(options.drift_scale);
  for (int i = 1; i <= 5; ++i) {
    const double way_m = kSegment_m * i;
    simulation.silences.push_back({way_m - kSilence_m, way_m});
    const double side = i % 2 == 0 ? -1.0 : 1.0;
    if (steps > 0) {
      simulation.jumps.push_back(
          {way_m, {steps * kJump_m, side * steps * kJump_m, side * steps * 0.15}, 0});
    }
  }
  return simulation;
}

absl::StatusOr<Simulation> BuildTerrain(const SceneOptions& options) {
  GEM_ASSIGN_OR_RETURN(EsriAsciiGrid grid, ReadEsriAscii(options.terrain_file));
  if (grid.columns < 2 || grid.rows < 2) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: %d x %d cells, want at least 2 x 2", options.terrain_file, grid.columns, grid.rows));
  }
  auto terrain = std::make_unique<GridTerrain>(std::move(grid));
  const Eigen::Vector2d low_m(terrain->x_m_min(), terrain->y_m_min());
  const Eigen::Vector2d high_m(terrain->x_m_max(), terrain->y_m_max());
  // Round the middle, well inside, and not farther than a demonstration has patience for.
  const Eigen::Vector2d middle_m = 0.5 * (low_m + high_m);
  const Eigen::Vector2d half_m = (0.3 * (high_m - low_m)).cwiseMin(30.0);
  const auto corner_m = [&](double x, double y) -> Eigen::Vector2d {
    return middle_m + half_m.cwiseProduct(Eigen::Vector2d(x, y));
  };
  Path path({corner_m(0, -1), corner_m(1, -1), corner_m(1, 1), corner_m(-1, 1), corner_m(-1, -1),
             corner_m(0.5, -1)},
            5.0);
  Simulation simulation = SimulationOn(std::move(path), 0.45, options);
  simulation.world = std::make_unique<World>(std::move(terrain));
  simulation.drift = DriftRatesOf(options.drift_scale);
  return simulation;
}

}  // namespace gem
