#include "client/cli/bench_local.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <limits>
#include <memory>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/cli/bench_global.h"
#include "client/datasets/kitti_source.h"
#include "core/base/status_macros.h"

namespace gem::client {
namespace {

using evaluation::Distribution_ms;
using evaluation::LocalBench;

struct BenchFlags {
  KittiOptions kitti;
  std::string pose_frame = "auto";
  std::string backend = "cpu";
  int threads = 1;
  LocalMapOptions map;
  std::size_t num_scans_max = std::numeric_limits<std::size_t>::max();
  bool json = false;
};

absl::Status RunBench(BenchFlags flags) {
  GEM_ASSIGN_OR_RETURN(LocalBackend backend, ParseLocalBackend(flags.backend));
  if (backend == LocalBackend::kAuto) {
    const BackendChoice choice = ChooseLocalBackend(backend);
    backend = choice.backend;
    if (!choice.why_not_cuda.empty())
      std::fprintf(stderr, "cpu backend: %s\n", choice.why_not_cuda.c_str());
  }
  GEM_ASSIGN_OR_RETURN(flags.kitti.pose_frame, ParseKittiPoseFrame(flags.pose_frame));
  GEM_ASSIGN_OR_RETURN(const std::unique_ptr<KittiSource> source, KittiSource::Open(flags.kitti));
  GEM_ASSIGN_OR_RETURN(
      const LocalBench bench,
      evaluation::BenchLocal(*source, backend, flags.map, flags.num_scans_max, flags.threads));
  std::fputs((flags.json ? BenchJson(bench) : BenchTable(bench)).c_str(), stdout);
  return absl::OkStatus();
}

}  // namespace

std::string BenchJson(const LocalBench& bench) {
  return absl::StrFormat(
      "{\"backend\":\"%s\",\"scans\":%d,\"points\":%d,\"cells\":%d,\"read_pass_ms\":%.4f,"
      "\"total_ms\":{\"median\":%.4f,\"p95\":%.4f},"
      "\"stages_ms\":{\"move\":%.4f,\"measure\":%.4f,\"fuse\":%.4f,\"annotate\":%.4f,"
      "\"clear\":%.4f}}\n",
      bench.backend, bench.num_scans, bench.points, bench.cells, bench.read_pass_ms,
      bench.total.median, bench.total.p95, bench.move.median, bench.measure.median,
      bench.fuse.median, bench.annotate.median, bench.clear.median);
}

std::string BenchTable(const LocalBench& bench) {
  std::string table = absl::StrFormat(
      "%s backend, %d scans, %d points a scan, %d cells\n%-12s %10s %10s\n", bench.backend,
      bench.num_scans, bench.points, bench.cells, "ms a scan", "median", "p95");
  const std::pair<const char*, Distribution_ms> rows[] = {
      {"move", bench.move},         {"measure", bench.measure}, {"fuse", bench.fuse},
      {"annotate", bench.annotate}, {"clear", bench.clear},     {"total", bench.total}};
  for (const auto& [name, distribution] : rows) {
    absl::StrAppendFormat(&table, "%-12s %10.3f %10.3f\n", name, distribution.median,
                          distribution.p95);
  }
  absl::StrAppendFormat(&table, "%-12s %10.3f\n", "read pass", bench.read_pass_ms);
  return table;
}

void AddBenchCommand(CLI::App& app, std::function<absl::Status()>& run) {
  CLI::App* bench = app.add_subcommand("bench", "Time parts of the system in this process");
  bench->require_subcommand(1);
  AddBenchGlobalCommand(*bench, run);
  CLI::App* local = bench->add_subcommand(
      "local", "The local mapper over a KITTI directory: velodyne/*.bin, times.txt, poses");
  const auto flags = std::make_shared<BenchFlags>();
  local->add_option("DIR", flags->kitti.dir, "Directory of the recording")->required();
  local->add_option("--poses", flags->kitti.poses,
                    "Poses, relative to DIR (default: poses.txt, or the only poses*.txt)");
  local->add_option("--pose_frame", flags->pose_frame, "velodyne, camera or auto")
      ->capture_default_str();
  local->add_option("--backend", flags->backend, "reference, cpu, cuda or auto")
      ->capture_default_str();
  local->add_option("--threads", flags->threads, "Threads of the mapper")->capture_default_str();
  local->add_option("--cell_size_m", flags->map.cell_size_m, "Edge of a cell")
      ->capture_default_str();
  local->add_option("--local_size_m", flags->map.side_m, "Edge of the window")
      ->capture_default_str();
  local->add_option("--scans", flags->num_scans_max, "At most so many scans (default: all)");
  local->add_flag("--json", flags->json, "For programs");
  local->callback([flags, &run] { run = [flags] { return RunBench(*flags); }; });
}

}  // namespace gem::client
