#include "client/evaluation/crowd.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/evaluation/crowd_tally.h"
#include "client/simulation/analytic_terrain.h"
#include "client/simulation/random.h"
#include "core/base/mutex.h"
#include "core/base/parallel_for.h"
#include "core/base/status_macros.h"
#include "core/local/local_mapper.h"

namespace gem::evaluation {
namespace {

constexpr std::array kCellSizes_m = {0.2, 0.1};
constexpr double kScenes = 10;
constexpr double kScans = 201;
constexpr std::size_t kWalkers = 30;
constexpr double kHalfLength_m = 14, kHalfWidth_m = 8;

Eigen::Vector2d PlaceIn(Random& random) {
  const double x_m = kHalfLength_m * (2 * random.Uniform() - 1);
  return {x_m, kHalfWidth_m * (2 * random.Uniform() - 1)};
}

/// Whether something stands within `reach_m` of the place; small things may slip through between
/// the eight places that are asked, and do not, as long as they are wider than a hand.
bool StandsNear(const World& world, const Eigen::Vector2d& place_m, double reach_m) {
  for (const double radius_m : {0.0, 0.33 * reach_m, 0.67 * reach_m, reach_m}) {
    for (int i = 0; i < 16; ++i) {
      const double angle_rad = i * std::acos(-1.0) / 8;
      const double x_m = place_m.x() + radius_m * std::cos(angle_rad);
      const double y_m = place_m.y() + radius_m * std::sin(angle_rad);
      if (world.TrueHeightAt(x_m, y_m).value_or(0) > 0) return true;
    }
  }
  return false;
}

void AddThings(World& world, Random& random) {
  // Parallel to the robot's way, with a gap to look through.
  world.Add(MakeWall({-9, 6.03}, {-2, 6.03}, 0.2, 0, 1.8));
  world.Add(MakeWall({1, -6.07}, {8, -6.07}, 0.2, 0, 1.8));
  int things = 0;
  while (things < 24) {
    const Eigen::Vector2d place_m = PlaceIn(random);
    const double yaw_rad = std::acos(-1.0) * random.Uniform();
    if (std::fabs(place_m.y()) < 1.6 || StandsNear(world, place_m, 1.5)) continue;
    if (things % 2 == 0)
      world.Add(MakeBox(place_m, {0.5, 0.5}, yaw_rad, 0, 0.5));
    else
      world.Add(Cylinder{.center_m = place_m, .radius_m = 0.1, .z_m_min = 0, .z_m_max = 1.0});
    ++things;
  }
}

/// Nobody walks into the robot or through a thing.
bool WalksFreely(const Walker& walker, const World& world, const Simulation& simulation) {
  constexpr double kElbowRoom_m = 0.75, kRobotRoom_m = 1.0;
  for (std::size_t step = 0; step < simulation.num_steps; ++step) {
    const auto s = static_cast<double>(step);
    const Eigen::Vector2d place_m = walker.At(s * simulation.robot.scan_period_s);
    const Eigen::Vector2d robot_m = simulation.path.At(s * simulation.robot.scan_spacing_m).place_m;
    if ((place_m - robot_m).norm() < kRobotRoom_m) return false;
    if (StandsNear(world, place_m, kElbowRoom_m)) return false;
  }
  return true;
}

/// One mapper of a scene, and what it does.
struct Watched {
  std::unique_ptr<LocalMapper> mapper;
  CrowdTally tally;
};

/// What is counted of one scene, by cell size.
using SceneTallies = std::vector<CrowdTally>;

absl::StatusOr<SceneTallies> WatchScene(SimulatedSource& source) {
  std::vector<Watched> watched;
  for (const double cell_size_m : kCellSizes_m) {
    LocalMapOptions options;
    options.side_m = 16;
    options.cell_size_m = static_cast<float>(cell_size_m);
    GEM_ASSIGN_OR_RETURN(auto mapper, MakeLocalMapper(LocalBackend::kCpu, options));
    watched.push_back({std::move(mapper), CrowdTally(source.world(), cell_size_m)});
  }
  SourceScan from;
  Scan scan;
  scan.T_B_S = source.T_B_S();
  scan.noise = source.noise();
  std::vector<EvictedCell> evicted;
  LocalMap map;
  while (true) {
    GEM_ASSIGN_OR_RETURN(const bool has_scan, source.Next(from));
    if (!has_scan) break;
    ++scan.seq;
    scan.stamp_ns = from.stamp_ns;
    scan.T_O_B = from.T_O_B;
    scan.points = from.points;
    for (Watched& one : watched) {
      evicted.clear();
      one.mapper->FuseScan(scan, evicted);
      one.mapper->CopyTo(map);
      one.tally.Add(map, (scan.T_O_B * scan.T_B_S).translation(),
                    SimulatedSource::WorldTime(from.stamp_ns));
    }
  }
  SceneTallies tallies;
  for (Watched& one : watched) tallies.push_back(std::move(one.tally));
  return tallies;
}

double Percent(std::int64_t part, std::int64_t whole) {
  return 100.0 * static_cast<double>(part) / static_cast<double>(std::max<std::int64_t>(whole, 1));
}

void AddFigures(const CrowdTally::Counts& counts, double cell_size_m, Report& report) {
  const auto add = [&](const char* what, double percent, double at_most) {
    report.figures.push_back({.name = absl::StrFormat("crowd, %g m: %s", cell_size_m, what),
                              .value = percent,
                              .unit = "%",
                              .at_most = at_most});
  };
  add("revealed cells that keep a trail", Percent(counts.trails, counts.revealed), 1);
  add("still high of walked cells in sight", Percent(counts.seen_trails, counts.seen), 1);
  add("cells of standing things lost", Percent(counts.standing_lost, counts.standing), 0.1);
  add("ground cells lost", Percent(counts.ground_lost, counts.ground), 0.1);
  report.figures.push_back({.name = absl::StrFormat("crowd, %g m: things lost", cell_size_m),
                            .value = static_cast<double>(counts.things_lost),
                            .at_most = 0});
}

std::string PartOf(std::int64_t part, std::int64_t whole) {
  return absl::StrFormat("%d of %d", part, whole);
}

std::vector<std::string> Row(double cell_size_m, const CrowdTally::Counts& counts) {
  return {absl::StrFormat("%g m", cell_size_m),
          absl::StrCat(counts.walked),
          PartOf(counts.trails, counts.revealed),
          PartOf(counts.hidden_trails, counts.walked - counts.revealed),
          PartOf(counts.seen_trails, counts.seen),
          PartOf(counts.things_lost, counts.things),
          PartOf(counts.standing_lost, counts.standing),
          PartOf(counts.edges_lost, counts.edges),
          PartOf(counts.ground_lost, counts.ground)};
}

Plot PlotOf(const std::vector<CrowdTally::Now>& by_scan, double cell_size_m) {
  Series walked{.name = "made high so far"}, trails{.name = "still high"},
      seen{.name = "still high, in sight"};
  for (const CrowdTally::Now& now : by_scan) {
    for (auto& [series, count] : {std::pair<Series&, int>{walked, now.walked},
                                  {trails, now.trails},
                                  {seen, now.seen_trails}}) {
      series.x.push_back(now.time_s);
      series.y.push_back(count);
    }
  }
  return {.name = "crowd",
          .title = absl::StrFormat("30 walkers: cells in the window that they have left, %g m",
                                   cell_size_m),
          .x_label = "time [s]",
          .y_label = "cells",
          .series = {walked, trails, seen}};
}

/// Why some cells are lost or stay.
void AddNotes(const CrowdTally::Counts& coarse, const CrowdTally::Counts& fine, Report& report) {
  report.notes.push_back(absl::StrFormat(
      "Cells that a thing covers at their edge only are not counted as standing. Where what stands "
      "in a cell is narrower than the gap between two columns of beams (4 cm at 7 m), the beams of "
      "a scan pass it on both sides, which is all that can be seen of an empty cell: %.1f %% of "
      "such cells at 0.2 m and %.1f %% at 0.1 m were low or unknown in some later map. Whether the "
      "thing stays in its other cells is what \"things lost\" tells.",
      Percent(coarse.edges_lost, coarse.edges), Percent(fine.edges_lost, fine.edges)));
  report.notes.push_back(absl::StrFormat(
      "A walked cell that does not come into clear sight again before it leaves the window (behind "
      "other walkers, walls and cubes) may never be seen to be free. Of those, %.0f %% at 0.2 m "
      "and "
      "%.0f %% at 0.1 m were still high in the end, and leave the window so; they go when the "
      "place "
      "is mapped again.",
      Percent(coarse.hidden_trails, coarse.walked - coarse.revealed),
      Percent(fine.hidden_trails, fine.walked - fine.revealed)));
}

}  // namespace

absl::StatusOr<std::unique_ptr<SimulatedSource>> MakeCrowd(std::uint64_t seed, int scans_max) {
  Simulation simulation(Path({{-10, 0}, {10, 0}}, 0));
  simulation.name = "crowd among things";
  simulation.seed = seed;
  simulation.robot.scan_spacing_m = 0.1;
  simulation.num_steps = static_cast<std::size_t>(scans_max);
  auto world = std::make_unique<World>(
      std::make_unique<AnalyticTerrain>(GroundPlane{}, std::vector<Hill>{}, std::vector<Step>{}));
  Random random(seed, /*stream=*/~std::uint64_t{3});
  AddThings(*world, random);
  while (world->walkers().size() < kWalkers) {
    Walker walker;
    for (int i = 0; i < 4; ++i) walker.path_m.push_back(PlaceIn(random));
    walker.speed_m_per_s = 0.8 + 0.8 * random.Uniform();
    walker.start_m = 40 * random.Uniform();
    if (WalksFreely(walker, *world, simulation)) world->Add(std::move(walker));
  }
  simulation.world = std::move(world);
  return SimulatedSource::Make(std::move(simulation));
}

absl::Status AddCrowd(const Settings& settings, Report& report) {
  const int scans = std::max(20, static_cast<int>(kScans * settings.scale));
  const auto num_scenes = static_cast<std::size_t>(std::ceil(kScenes * settings.scale));
  std::array<CrowdTally::Counts, kCellSizes_m.size()> counts{};
  Mutex mutex;
  std::size_t done = 0;
  absl::Status failed;
  ParallelFor(num_scenes, settings.threads, [&](std::size_t i) {
    auto source = MakeCrowd(settings.seed * 100 + i, scans);
    const absl::StatusOr<SceneTallies> tallies =
        source.ok() ? WatchScene(**source) : absl::StatusOr<SceneTallies>(source.status());
    MutexLock lock(mutex);
    settings.progress("crowd",
                      0.3 + 0.6 * static_cast<double>(++done) / static_cast<double>(num_scenes));
    failed.Update(tallies.status());
    for (std::size_t k = 0; k < counts.size() && tallies.ok(); ++k)
      counts[k] += (*tallies)[k].Count();
    if (i == 0 && tallies.ok())
      report.plots.push_back(PlotOf(tallies->front().by_scan(), kCellSizes_m[0]));
  });
  GEM_RETURN_IF_ERROR(failed);
  Table table{
      .title = absl::StrFormat("The crowd, %d scenes of %d scans, cells", num_scenes, scans),
      .columns = {"cell", "walked", "trails in revealed cells", "trails in hidden cells",
                  "high in sight, all scans", "things lost", "standing lost", "edges lost",
                  "ground lost"}};
  for (std::size_t k = 0; k < counts.size(); ++k) {
    AddFigures(counts[k], kCellSizes_m[k], report);
    table.rows.push_back(Row(kCellSizes_m[k], counts[k]));
  }
  report.tables.push_back(std::move(table));
  AddNotes(counts.front(), counts.back(), report);
  return absl::OkStatus();
}

}  // namespace gem::evaluation
