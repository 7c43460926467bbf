#include "client/cli/bench_soak.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <memory>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/cli/json.h"
#include "client/simulation/scenes.h"
#include "core/base/status_macros.h"

namespace gem::client {
namespace {

using load::Growth;
using load::SoakCounts;
using load::SoakReport;

/// Small scans: many of them do more harm than few large ones.
constexpr int kRings = 16;
constexpr int kAzimuths = 512;
constexpr int kScansOfTape = 40;
constexpr double kWarmUpShare = 0.2;

struct SoakFlags {
  double minutes = 10;
  load::SoakOptions options;
  bool json = false;
};

absl::Status RunSoak(SoakFlags flags) {
  SceneOptions scene;
  scene.rings = kRings;
  scene.azimuths = kAzimuths;
  scene.scans_max = kScansOfTape;
  GEM_ASSIGN_OR_RETURN(const auto source, MakeScene(scene));
  GEM_ASSIGN_OR_RETURN(const std::unique_ptr<const load::ScanTape> tape,
                       load::ScanTape::Record(*source, IngestOptions(), kScansOfTape));
  flags.options.seconds = flags.minutes * 60;
  flags.options.warm_up_s = flags.options.seconds * kWarmUpShare;
  GEM_ASSIGN_OR_RETURN(const SoakReport report, load::Soak(*tape, flags.options));
  std::fputs((flags.json ? SoakJson(report) : SoakTable(report)).c_str(), stdout);
  return load::JudgeSoak(report);
}

std::string Json(const Growth& growth) {
  return absl::StrCat("{\"median\":", JsonNumber(growth.median),
                      ",\"max\":", JsonNumber(growth.max),
                      ",\"growth\":", JsonNumber(growth.growth), "}");
}

}  // namespace

std::string SoakTable(const SoakReport& report) {
  const SoakCounts& c = report.counts;
  std::string table = absl::StrFormat(
      "%.0f s: %d sessions, %d streams cut, %d scans, %d corrections, %d tiles, %d watches, "
      "%d maps deleted, %d refusals; exit code %d\n\n",
      report.seconds, c.sessions, c.cuts, c.scans, c.corrections, c.tiles, c.watches,
      c.maps_deleted, c.refusals, report.exit_code);
  absl::StrAppendFormat(&table, "%-12s %10s %10s %10s   (%d samples)\n", "server", "median", "max",
                        "growth", report.num_samples);
  const auto row = [&](const char* name, const Growth& growth, double unit) {
    absl::StrAppendFormat(&table, "%-12s %10.1f %10.1f %+10.1f\n", name, growth.median / unit,
                          growth.max / unit, growth.growth / unit);
  };
  row("memory MiB", report.growth.resident_bytes, 1 << 20);
  row("threads", report.growth.threads, 1);
  row("open files", report.growth.open_files, 1);
  return table;
}

std::string SoakJson(const SoakReport& report) {
  const SoakCounts& c = report.counts;
  return absl::StrCat("{\"seconds\":", JsonNumber(report.seconds),
                      ",\"num_samples\":", report.num_samples, ",\"sessions\":", c.sessions,
                      ",\"cuts\":", c.cuts, ",\"scans\":", c.scans,
                      ",\"corrections\":", c.corrections, ",\"tiles\":", c.tiles,
                      ",\"watches\":", c.watches, ",\"maps_deleted\":", c.maps_deleted,
                      ",\"refusals\":", c.refusals, ",\"exit_code\":", report.exit_code,
                      ",\"resident_bytes\":", Json(report.growth.resident_bytes),
                      ",\"threads\":", Json(report.growth.threads),
                      ",\"open_files\":", Json(report.growth.open_files), "}\n");
}

void AddBenchSoakCommand(CLI::App& bench, std::function<absl::Status()>& run) {
  CLI::App* soak = bench.add_subcommand(
      "soak",
      "A server of its own under robots, planners and watchers that come and go; fails if "
      "it grows");
  const auto flags = std::make_shared<SoakFlags>();
  soak->add_option("--minutes", flags->minutes, "How long; a fifth of it is warm-up")
      ->capture_default_str()
      ->check(CLI::Range(0.1, 1e4));
  soak->add_option("--robots", flags->options.robots, "At once")->capture_default_str();
  soak->add_option("--planners", flags->options.planners, "At once")->capture_default_str();
  soak->add_option("--watchers", flags->options.watchers, "At once")->capture_default_str();
  soak->add_option("--seed", flags->options.seed, "Of what they do")->capture_default_str();
  soak->add_flag("--json", flags->json, "For programs");
  soak->callback([flags, &run] { run = [flags] { return RunSoak(*flags); }; });
}

}  // namespace gem::client
