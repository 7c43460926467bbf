#include "client/evaluation/timing.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <limits>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/datasets/kitti_source.h"
#include "client/simulation/scenes.h"
#include "core/base/status_macros.h"

namespace gem::evaluation {
namespace {

/// Table II.
struct PaperColumn {
  const char* name;
  double build_ms, annotate_ms, clear_ms, total_ms;  ///< NaN: the method has no such step
};
constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
constexpr std::array kPaper = {
    PaperColumn{"paper: Elevation Mapping, i7-8700", 256, kNone, 893, 548},
    PaperColumn{"paper: GEM, GTX 1060", 20, 15, 1, 48},
    PaperColumn{"paper: GEM, TX2", 66, 49, 4, 171}};

struct Window {
  double side_m;
  double cell_size_m;

  std::string Name() const { return absl::StrFormat("%gx%g m, %g m", side_m, side_m, cell_size_m); }
  LocalMapOptions Options() const {
    LocalMapOptions options;
    options.side_m = static_cast<float>(side_m);
    options.cell_size_m = static_cast<float>(cell_size_m);
    return options;
  }
};
/// The paper's, that of Table II first.
constexpr std::array kWindows = {Window{8, 0.2}, Window{8, 0.1}, Window{16, 0.2}, Window{16, 0.1}};

constexpr int kRuns = 5;

/// Scans to be timed, opened anew for each run.
struct Recording {
  std::string name;
  OpenSource open;
};

Recording Kitti(const std::string& name, KittiOptions options) {
  return {name, [options = std::move(options)]() -> absl::StatusOr<std::unique_ptr<ScanSource>> {
            return KittiSource::Open(options);
          }};
}

std::vector<Recording> Recordings(const Settings& settings, Report& report) {
  if (settings.data_dir.has_value()) {
    const std::filesystem::path& dir = *settings.data_dir;
    return {Kitti("KITTI odometry 00", {.dir = dir / "sequences" / "00",
                                        .poses = {},
                                        .corrected = {},
                                        .pose_frame = KittiPoseFrame::kAutomatic}),
            Kitti("keyframes of KITTI 00", {.dir = dir / "kitti_00_keyframes",
                                            .poses = "poses_odometry.txt",
                                            .corrected = {},
                                            .pose_frame = KittiPoseFrame::kAutomatic})};
  }
  report.skipped.push_back("real scans: no --data; a simulated street is timed instead");
  SceneOptions options;
  options.name = "block";
  options.seed = settings.seed;
  options.scans_max = std::max(3, static_cast<int>(40 * settings.scale));
  return {{"simulated block", [options]() -> absl::StatusOr<std::unique_ptr<ScanSource>> {
             return MakeScene(options);
           }}};
}

std::string Milliseconds(double value_ms) {
  if (!std::isfinite(value_ms)) return "-";
  return value_ms < 10 ? absl::StrFormat("%.3f", value_ms) : absl::StrFormat("%.0f", value_ms);
}

/// What the times were measured on; empty where the system does not tell.
std::string ProcessorName() {
  std::ifstream file("/proc/cpuinfo");
  for (std::string line; std::getline(file, line);) {
    const std::size_t colon = line.find(": ");
    if (line.rfind("model name", 0) == 0 && colon != std::string::npos)
      return line.substr(colon + 2);
  }
  return {};
}

/// All runs of one recording.
struct Runs {
  std::array<std::vector<ScanTiming>, kWindows.size()> scans;  ///< by window, backend cpu
  std::array<LocalBench, kWindows.size()> cpu;                 ///< the same, summarised
  LocalBench reference;                                        ///< of the first window
};

absl::StatusOr<Runs> Measure(const Recording& recording, const Settings& settings, double begin,
                             double share) {
  // The reference asks every ray for every cell: a few scans tell enough.
  constexpr std::size_t kReferenceScans = 11;
  constexpr double kScans = 100;
  const auto scans_max =
      static_cast<std::size_t>(std::max(3.0, std::ceil(kScans * settings.scale)));
  Runs runs;
  for (std::size_t i = 0; i < kWindows.size(); ++i) {
    settings.progress(recording.name, begin + share * static_cast<double>(i) / kWindows.size());
    const LocalMapOptions options = kWindows[i].Options();
    GEM_ASSIGN_OR_RETURN(runs.scans[i], TimeScansAtBest(recording.open, LocalBackend::kCpu, options,
                                                        scans_max, kRuns));
    runs.cpu[i] = Summarise(LocalBackend::kCpu, options, runs.scans[i]);
  }
  const LocalMapOptions options = kWindows[0].Options();
  GEM_ASSIGN_OR_RETURN(const std::vector<ScanTiming> scans,
                       TimeScansAtBest(recording.open, LocalBackend::kReference, options,
                                       std::min(kReferenceScans, scans_max), /*num_runs=*/1));
  runs.reference = Summarise(LocalBackend::kReference, options, scans);
  return runs;
}

Table StagesTable(const std::string& recording, const Runs& runs) {
  Table table{
      .title = absl::StrFormat("%s: medians over %d scans, ms (backend cpu, one thread)", recording,
                               runs.cpu[0].num_scans),
      .columns = {"window", "cells", "points", "in the window", "move", "measure", "fuse",
                  "annotate", "clear", "total", "95 % of scans", "read pass", "total / read pass"}};
  const auto add = [&](const std::string& name, const LocalBench& bench) {
    table.rows.push_back({name, absl::StrCat(bench.cells), absl::StrCat(bench.points),
                          absl::StrCat(bench.points_in_window), Milliseconds(bench.move.median),
                          Milliseconds(bench.measure.median), Milliseconds(bench.fuse.median),
                          Milliseconds(bench.annotate.median), Milliseconds(bench.clear.median),
                          Milliseconds(bench.total.median), Milliseconds(bench.total.p95),
                          Milliseconds(bench.read_pass_ms),
                          absl::StrFormat("%.1f", bench.total.median / bench.read_pass_ms)});
  };
  for (std::size_t i = 0; i < kWindows.size(); ++i) add(kWindows[i].Name(), runs.cpu[i]);
  add(absl::StrFormat("%s, backend reference, %d scans", kWindows[0].Name(),
                      runs.reference.num_scans),
      runs.reference);
  return table;
}

/// Table II with our columns beside it.
Table PaperTable(const std::string& recording, const Runs& runs) {
  const PaperSteps_ms cpu = PaperStepsOf(runs.cpu[0]), reference = PaperStepsOf(runs.reference);
  Table table{
      .title = absl::StrFormat("Table II, ms a scan, %s (ours: %s)", kWindows[0].Name(), recording),
      .columns = {"step"},
      .rows = {{"geometric map building"},
               {"traversability annotation"},
               {"dynamic objects process"},
               {"total"}}};
  const auto add = [&](const std::string& name, std::array<double, 4> values_ms) {
    table.columns.push_back(name);
    for (std::size_t i = 0; i < values_ms.size(); ++i)
      table.rows[i].push_back(Milliseconds(values_ms[i]));
  };
  for (const PaperColumn& column : kPaper)
    add(column.name, {column.build_ms, column.annotate_ms, column.clear_ms, column.total_ms});
  add("ours: reference", {reference.build, reference.annotate, reference.clear, reference.total});
  add("ours: cpu", {cpu.build, cpu.annotate, cpu.clear, cpu.total});
  return table;
}

void AddFigures(const std::string& recording, const Runs& runs, Report& report) {
  const auto add = [&](const std::string& name, Figure figure) {
    figure.name = absl::StrCat(recording, ": ", name);
    report.figures.push_back(std::move(figure));
  };
  const LocalBench& first = runs.cpu[0];
  add(absl::StrCat("total of a scan, ", kWindows[0].Name()),
      {.value = first.total.median, .unit = "ms", .at_most = 1, .paper = kPaper[1].total_ms});
  add("the same / reading every point once",
      {.value = first.total.median / first.read_pass_ms, .at_most = 6});
  add("total of a scan, backend reference",
      {.value = runs.reference.total.median, .unit = "ms", .paper = kPaper[0].total_ms});
  for (const std::size_t i : {1, 2})
    add(absl::StrCat("time of ", kWindows[i].Name(), " (4 times the cells) / of ",
                     kWindows[0].Name()),
        {.value = runs.cpu[i].total.median / first.total.median, .at_most = 2, .paper = 2});
}

/// Where the time goes that the aims do not allow.
void AddNotes(const std::string& recording, const Runs& runs, Report& report) {
  const LocalBench &small = runs.cpu[0], &large = runs.cpu[2];
  report.notes.push_back(absl::StrFormat(
      "%s: each of the %d points is turned and gated (measure, %.1f read passes) and its ray is "
      "entered in the table that clears (clear, %.1f read passes); fusing and annotating take "
      "%.1f. Six read passes would leave about %.1f ns for all of it a point.",
      recording, small.points, small.measure.median / small.read_pass_ms,
      small.clear.median / small.read_pass_ms,
      (small.fuse.median + small.annotate.median) / small.read_pass_ms,
      6e6 * small.read_pass_ms / static_cast<double>(std::max<std::size_t>(small.points, 1))));
  report.notes.push_back(absl::StrFormat(
      "%s: the window of %s holds 4 times the cells, but %.1f times the points of that of %s, as "
      "the sensor's lowest beams pass over most of the small one. Fusing takes %.3f instead of "
      "%.3f ms and annotating %.3f instead of %.3f ms; with 4 times the cells and the same points "
      "(%s) the factor is %.2f.",
      recording, kWindows[2].Name(),
      static_cast<double>(large.points_in_window) /
          static_cast<double>(std::max<std::size_t>(small.points_in_window, 1)),
      kWindows[0].Name(), large.fuse.median, small.fuse.median, large.annotate.median,
      small.annotate.median, kWindows[1].Name(), runs.cpu[1].total.median / small.total.median));
}

Plot PlotOf(const std::string& recording, const Runs& runs, std::size_t index) {
  Plot plot{.name = absl::StrCat("scans_", index),
            .title = absl::StrCat("Time of each scan, ", recording),
            .x_label = "scan",
            .y_label = "total [ms]"};
  for (std::size_t i = 0; i < kWindows.size(); ++i) {
    Series series{.name = kWindows[i].Name()};
    for (std::size_t scan = 0; scan < runs.scans[i].size(); ++scan) {
      series.x.push_back(static_cast<double>(scan));
      series.y.push_back(1e3 * runs.scans[i][scan].report.seconds.total());
    }
    plot.series.push_back(std::move(series));
  }
  return plot;
}

}  // namespace

PaperSteps_ms PaperStepsOf(const LocalBench& bench) {
  return {.build = bench.move.median + bench.measure.median + bench.fuse.median,
          .annotate = bench.annotate.median,
          .clear = bench.clear.median,
          .total = bench.total.median};
}

absl::StatusOr<std::vector<ScanTiming>> TimeScansAtBest(const OpenSource& open,
                                                        LocalBackend backend,
                                                        const LocalMapOptions& options,
                                                        std::size_t num_scans_max, int num_runs) {
  std::vector<ScanTiming> best;
  for (int run = 0; run < num_runs; ++run) {
    GEM_ASSIGN_OR_RETURN(const auto source, open());
    GEM_ASSIGN_OR_RETURN(std::vector<ScanTiming> scans,
                         TimeScans(*source, backend, options, num_scans_max));
    if (run == 0) best = scans;
    for (std::size_t i = 0; i < std::min(best.size(), scans.size()); ++i) {
      if (scans[i].report.seconds.total() < best[i].report.seconds.total())
        best[i].report = scans[i].report;
      best[i].read_pass_s = std::min(best[i].read_pass_s, scans[i].read_pass_s);
    }
  }
  return best;
}

absl::StatusOr<Report> RunTiming(const Settings& settings) {
  Report report{.name = "timing", .title = "Table II: time of the local mapper"};
  const std::vector<Recording> recordings = Recordings(settings, report);
  const double share = 1.0 / static_cast<double>(recordings.size());
  for (std::size_t i = 0; i < recordings.size(); ++i) {
    const std::string& name = recordings[i].name;
    GEM_ASSIGN_OR_RETURN(const Runs runs,
                         Measure(recordings[i], settings, share * static_cast<double>(i), share));
    AddFigures(name, runs, report);
    if (i == 0) report.tables.push_back(PaperTable(name, runs));
    report.tables.push_back(StagesTable(name, runs));
    report.plots.push_back(PlotOf(name, runs, i));
    if (i == 0) AddNotes(name, runs, report);
  }
  report.method = absl::StrFormat(
      "Every scan goes whole through a fresh local mapper in this process, on one thread of %s. "
      "The total holds all the mapper does with a scan from the points in memory to the map that "
      "can be read: moving the window and evicting what leaves it, transforming and gating all "
      "points, fusing, annotating, clearing and annotating again. A CPU backend has no transfers; "
      "reading the scan's file is not timed. Points are those of the whole scan; \"in the window\" "
      "are those that lie over the window and in its height, the others still clear. The read pass "
      "sums x, y and z of every point of the scan once, right before the mapper gets it: what "
      "memory alone would cost. Each run is repeated %d times, and the one of the lowest median "
      "counts. "
      "The paper's baseline (Elevation Mapping [8]) stands beside our "
      "`reference` backend, plain loops that ask every ray for every cell.",
      ProcessorName().empty() ? std::string("an unnamed processor") : ProcessorName(), kRuns);
  if (settings.scale < 1)
    report.method += absl::StrFormat(" Run at %g of the full size.", settings.scale);
  report.notes.push_back(
      "The steps of the paper's columns do not add up to its totals (256 + 893 is not 548, 20 + 15 "
      "+ 1 is not 48); they are shown as printed. That four times the cells cost less than twice "
      "the time is the paper's claim about its Fig. 6, so 2 stands as its number.");
  return report;
}

}  // namespace gem::evaluation
