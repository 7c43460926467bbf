#include "client/cli/bench_global.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>

#include "client/evaluation/global_bench.h"
#include "core/base/status_macros.h"

namespace gem::client {
namespace {

struct BenchGlobalFlags {
  evaluation::GlobalBenchOptions bench;
  bool json = false;
};

absl::Status RunBenchGlobal(const BenchGlobalFlags& flags) {
  GEM_ASSIGN_OR_RETURN(const evaluation::GlobalBench bench, evaluation::BenchGlobal(flags.bench));
  std::fputs((flags.json ? GlobalBenchJson(bench) : GlobalBenchTable(bench)).c_str(), stdout);
  return absl::OkStatus();
}

}  // namespace

void AddBenchGlobalCommand(CLI::App& bench, std::function<absl::Status()>& run) {
  CLI::App* global = bench.add_subcommand(
      "global", "Corrections and composing on a made-up map of a given length");
  const auto flags = std::make_shared<BenchGlobalFlags>();
  global->add_option("--way_m", flags->bench.way_m, "Length of the robot's way")
      ->capture_default_str();
  global->add_option("--width_m", flags->bench.width_m, "Width of the mapped strip")
      ->capture_default_str();
  global->add_option("--cell_size_m", flags->bench.cell_size_m, "Edge of a cell")
      ->capture_default_str();
  global->add_option("--submap_length_m", flags->bench.submap_length_m, "Way of a submap")
      ->capture_default_str();
  global->add_option("--threads", flags->bench.threads, "Threads that render tiles")
      ->capture_default_str();
  global->add_option("--corrections", flags->bench.num_corrections, "How many are timed")
      ->capture_default_str();
  global->add_flag("--json", flags->json, "For programs");
  global->callback([flags, &run] { run = [flags] { return RunBenchGlobal(*flags); }; });
}

}  // namespace gem::client
