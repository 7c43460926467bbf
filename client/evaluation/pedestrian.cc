#include "client/evaluation/pedestrian.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/evaluation/mapping_robot.h"
#include "client/simulation/analytic_terrain.h"
#include "client/simulation/simulated_source.h"
#include "core/base/check.h"
#include "core/base/status_macros.h"

namespace gem::evaluation {
namespace {

constexpr double kPersonRadius_m = 0.3;
constexpr double kPillarRadius_m = 0.35;
constexpr double kReach_m = 0.7;
/// Over the ground at 0, also while the second pass is out by half a metre.
constexpr double kHigh_m = 0.8;
constexpr double kScanSpacing_m = 0.5;
constexpr double kScanPeriod_s = 0.1;

struct Places {
  Eigen::Vector2d person_m;
  Eigen::Vector2d pillar_m;
};
/// To either side of the middle of the way.
Places PlacesOn(const PassOptions& options) {
  return {{0.5 * options.way_m, 2.0}, {0.5 * options.way_m, -2.0}};
}

absl::StatusOr<std::unique_ptr<SimulatedSource>> MakePass(const PassOptions& options,
                                                          bool with_person) {
  Simulation simulation(Path({{0, 0}, {options.way_m, 0}}, 0));
  simulation.name = with_person ? "first pass" : "second pass";
  simulation.seed = options.seed + (with_person ? 0 : 1);
  simulation.robot.scan_spacing_m = kScanSpacing_m;
  simulation.robot.scan_period_s = kScanPeriod_s;
  simulation.num_steps = static_cast<std::size_t>(options.way_m / kScanSpacing_m) + 1;
  auto world = std::make_unique<World>(
      std::make_unique<AnalyticTerrain>(GroundPlane{}, std::vector<Hill>{}, std::vector<Step>{}));
  const Places places = PlacesOn(options);
  world->Add(Cylinder{
      .center_m = places.pillar_m, .radius_m = kPillarRadius_m, .z_m_min = 0, .z_m_max = 1.5});
  if (with_person) {
    Walker person;
    person.path_m = {places.person_m};
    person.radius_m = kPersonRadius_m;
    world->Add(std::move(person));
  }
  simulation.world = std::move(world);
  return SimulatedSource::Make(std::move(simulation));
}

/// Fuses all scans of the pass, `later_ns` after their own time, where odometry is out by T_O_G.
absl::Status Drive(SimulatedSource& source, std::int64_t later_ns, const Pose<Odom, Global>& T_O_G,
                   MappingRobot& robot, CorrectedTrajectory& truth) {
  SourceScan scan;
  while (true) {
    GEM_ASSIGN_OR_RETURN(const bool has_scan, source.Next(scan));
    if (!has_scan) return absl::OkStatus();
    const std::int64_t stamp_ns = scan.stamp_ns + later_ns;
    robot.Fuse(stamp_ns, T_O_G * *scan.T_G_B, scan.points);
    truth.push_back({stamp_ns, *scan.T_G_B});
  }
}

/// To a place of which nothing is seen, so that all that was seen leaves the local map and the
/// submap ends.
void LeaveTown(const PassOptions& options, MappingRobot& robot, CorrectedTrajectory& truth) {
  const Eigen::Vector3d far_m(0.5 * options.way_m, 200, 0);
  const std::int64_t stamp_ns = truth.back().stamp_ns + 1'000'000'000;
  robot.Fuse(stamp_ns, {Eigen::Quaterniond::Identity(), far_m}, {});
  truth.push_back({stamp_ns, {Eigen::Quaterniond::Identity(), far_m}});
}

PassView ViewOf(const MapSnapshot& map, const PassOptions& options) {
  const Places places = PlacesOn(options);
  return {.pedestrian = CountHigh(map, places.person_m, kReach_m, kHigh_m),
          .pillar = CountHigh(map, places.pillar_m, kReach_m, kHigh_m),
          .num_submaps = map.submaps.size(),
          .num_points = map.num_points};
}

std::vector<std::string> Row(const std::string& when, const PassView& view) {
  return {when, absl::StrCat(view.pedestrian), absl::StrCat(view.pillar),
          absl::StrCat(view.num_submaps), absl::StrCat(view.num_points)};
}

}  // namespace

int CountHigh(const MapSnapshot& map, const Eigen::Vector2d& place_m, double reach_m,
              double height_m_min) {
  const auto cell_size_m = static_cast<double>(map.options.cell_size_m);
  const CellIndex low = CellAt(place_m.x() - reach_m, place_m.y() - reach_m, cell_size_m);
  const CellIndex high = CellAt(place_m.x() + reach_m, place_m.y() + reach_m, cell_size_m);
  int count = 0;
  for (std::int32_t y = low.y; y <= high.y; ++y) {
    for (std::int32_t x = low.x; x <= high.x; ++x) {
      const Eigen::Vector2d center_m(CenterOf(x, cell_size_m), CenterOf(y, cell_size_m));
      const auto tile = map.tiles.find(TileOf({x, y}));
      if (tile == map.tiles.end() || (center_m - place_m).norm() > reach_m) continue;
      const CellBelief& cell = tile->second->cells[static_cast<std::size_t>(IndexInTile({x, y}))];
      count += cell.known() && static_cast<double>(cell.elevation_m) > height_m_min;
    }
  }
  return count;
}

absl::StatusOr<TwoPasses> DriveTwice(const PassOptions& options) {
  GEM_ASSIGN_OR_RETURN(const auto first_pass, MakePass(options, /*with_person=*/true));
  GEM_ASSIGN_OR_RETURN(const auto second_pass, MakePass(options, /*with_person=*/false));
  RobotSetup setup;
  setup.T_B_S = first_pass->T_B_S();
  setup.noise = first_pass->noise();
  setup.map.merge_overlap_min = options.merge_overlap_min;
  GEM_ASSIGN_OR_RETURN(const auto robot, MappingRobot::Make(setup));
  CorrectedTrajectory truth;
  TwoPasses passes;
  GEM_RETURN_IF_ERROR(Drive(*first_pass, 0, {}, *robot, truth));
  LeaveTown(options, *robot, truth);
  robot->Commit(/*show_local=*/false);
  passes.first = ViewOf(*robot->snapshot(), options);

  const std::int64_t later_ns = truth.back().stamp_ns + std::llround(options.gap_s * 1e9);
  const Pose<Odom, Global> T_O_G(Eigen::Quaterniond::Identity(), {0.4, -0.3, 0.5});
  GEM_RETURN_IF_ERROR(Drive(*second_pass, later_ns, T_O_G, *robot, truth));
  LeaveTown(options, *robot, truth);
  robot->Commit(/*show_local=*/false);
  passes.second = ViewOf(*robot->snapshot(), options);

  GEM_RETURN_IF_ERROR(robot->Correct(std::move(truth)).status());
  robot->End();
  passes.corrected = ViewOf(*robot->snapshot(), options);
  return passes;
}

absl::Status AddPedestrian(const Settings& settings, Report& report) {
  PassOptions options;
  options.seed = settings.seed;
  GEM_ASSIGN_OR_RETURN(const TwoPasses merged, DriveTwice(options));
  options.merge_overlap_min = 1000;
  GEM_ASSIGN_OR_RETURN(const TwoPasses apart, DriveTwice(options));
  const auto add = [&](const char* what, double value, std::optional<double> at_most,
                       std::optional<double> at_least, const char* unit) {
    report.figures.push_back({.name = absl::StrCat("pedestrian: ", what),
                              .value = value,
                              .unit = unit,
                              .at_most = at_most,
                              .at_least = at_least});
  };
  add("high cells where he stood, first pass", merged.first.pedestrian, {}, 4, "cells");
  add("the same, mapped again and merged", merged.corrected.pedestrian, 0, {}, "cells");
  add("high cells of the pillar, mapped again / first pass",
      static_cast<double>(merged.corrected.pillar) / std::max(merged.first.pillar, 1), 1.5, 0.5,
      "");
  add("stored cells, mapped again / first pass",
      static_cast<double>(merged.corrected.num_points) /
          static_cast<double>(merged.first.num_points),
      1.2, {}, "");
  report.tables.push_back(
      {.title = "A pedestrian who was there in the first pass only",
       .columns = {"map", "high where he stood", "high at the pillar", "submaps", "stored cells"},
       .rows = {Row("after the first pass", merged.first),
                Row("after the second, not yet corrected", merged.second),
                Row("corrected and merged", merged.corrected),
                Row("control: corrected, never merged", apart.corrected)}});
  return absl::OkStatus();
}

}  // namespace gem::evaluation
