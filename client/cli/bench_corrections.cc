#include "client/cli/bench_corrections.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>

#include "client/evaluation/corrections_bench.h"
#include "core/base/status_macros.h"

namespace gem::client {
namespace {

struct BenchCorrectionsFlags {
  evaluation::CorrectionsBenchOptions bench;
  bool json = false;
};

absl::Status RunBenchCorrections(const BenchCorrectionsFlags& flags) {
  GEM_ASSIGN_OR_RETURN(const evaluation::CorrectionsBench bench,
                       evaluation::BenchCorrections(flags.bench));
  std::fputs((flags.json ? CorrectionsBenchJson(bench) : CorrectionsBenchTable(bench)).c_str(),
             stdout);
  if (bench.num_different_cells == 0) return absl::OkStatus();
  return absl::InternalError("the map is not the one that the last correction alone gives");
}

}  // namespace

void AddBenchCorrectionsCommand(CLI::App& bench, std::function<absl::Status()>& run) {
  CLI::App* corrections = bench.add_subcommand(
      "corrections", "Ten corrections a second of a large map beside a streaming robot");
  const auto flags = std::make_shared<BenchCorrectionsFlags>();
  corrections->add_option("--way_m", flags->bench.way_m, "Way that is mapped before")
      ->capture_default_str();
  corrections->add_option("--width_m", flags->bench.width_m, "Width of the mapped strip")
      ->capture_default_str();
  corrections
      ->add_option("--seconds", flags->bench.seconds, "Time with corrections; as long without")
      ->capture_default_str();
  corrections->add_option("--block_s", flags->bench.block_s, "With and without take turns so long")
      ->capture_default_str();
  corrections->add_option("--hz", flags->bench.corrections_hz, "Corrections a second")
      ->capture_default_str();
  corrections->add_flag("--json", flags->json, "For programs");
  corrections->callback([flags, &run] { run = [flags] { return RunBenchCorrections(*flags); }; });
}

}  // namespace gem::client
