#include "client/cli/evaluate_command.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>
#include <system_error>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/cli/progress_bar.h"
#include "client/evaluation/experiment.h"
#include "client/evaluation/report_text.h"
#include "client/evaluation/svg_plot.h"
#include "client/formats/text_file.h"
#include "core/base/status_macros.h"

namespace gem::client {
namespace {

namespace fs = std::filesystem;
using evaluation::Experiment;
using evaluation::Experiments;
using evaluation::Report;
using evaluation::Settings;

struct EvaluateFlags {
  std::string name = "all";
  std::string out_dir;
  std::string data_dir;
  double scale = 1;
  int threads = 2;
  std::uint64_t seed = 1;
  bool json = false;
};

constexpr std::uint64_t kProgressSteps = 1000;

std::vector<const Experiment*> Chosen(const std::string& name) {
  std::vector<const Experiment*> chosen;
  for (const Experiment& experiment : Experiments())
    if (name == "all" || name == experiment.name) chosen.push_back(&experiment);
  return chosen;
}

absl::Status MakeDirectory(const fs::path& dir) {
  std::error_code error;
  fs::create_directories(dir, error);
  if (!error) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat(dir.string(), ": ", error.message()));
}

absl::Status WritePlots(const Report& report, const fs::path& dir) {
  GEM_RETURN_IF_ERROR(MakeDirectory(dir));
  for (const evaluation::Plot& plot : report.plots)
    GEM_RETURN_IF_ERROR(WriteFileAtomically(dir / (plot.name + ".svg"), evaluation::DrawSvg(plot)));
  return WriteFileAtomically(dir / "report.json", evaluation::Json(report));
}

void PrintFigures(const Report& report, double elapsed_s) {
  std::printf("%s (%.0f s)\n", report.title.c_str(), elapsed_s);
  for (const evaluation::Figure& figure : report.figures)
    std::printf("  %-60s %10.4g %-6s%s\n", figure.name.c_str(), figure.value, figure.unit.c_str(),
                figure.missed() ? " missed" : "");
  for (const std::string& part : report.skipped) std::printf("  skipped: %s\n", part.c_str());
  std::fflush(stdout);
}

absl::StatusOr<Report> RunOne(const Experiment& experiment, const EvaluateFlags& flags) {
  ProgressBar bar(experiment.name, {.total = kProgressSteps});
  Settings settings;
  if (!flags.data_dir.empty()) settings.data_dir = flags.data_dir;
  settings.scale = flags.scale;
  settings.threads = flags.threads;
  settings.seed = flags.seed;
  settings.progress = [&bar](const std::string&, double share) {
    bar.Show(static_cast<std::uint64_t>(std::clamp(share, 0.0, 1.0) * kProgressSteps));
  };
  return experiment.run(settings);
}

absl::Status Evaluate(const EvaluateFlags& flags) {
  const std::vector<const Experiment*> chosen = Chosen(flags.name);
  if (chosen.empty())
    return absl::InvalidArgumentError(
        absl::StrCat("there is no experiment \"", flags.name, "\"; see gem evaluate --help"));
  const fs::path out = flags.out_dir;
  std::string text;
  for (const Experiment* experiment : chosen) {
    const auto begin = std::chrono::steady_clock::now();
    GEM_ASSIGN_OR_RETURN(const Report report, RunOne(*experiment, flags));
    const std::chrono::duration<double> elapsed = std::chrono::steady_clock::now() - begin;
    if (flags.json) {
      std::fputs(evaluation::Json(report).c_str(), stdout);
      std::fflush(stdout);
    } else {
      PrintFigures(report, elapsed.count());
    }
    GEM_RETURN_IF_ERROR(WritePlots(report, out / report.name));
    absl::StrAppend(&text, evaluation::Markdown(report, flags.out_dir), "\n");
    GEM_RETURN_IF_ERROR(
        WriteFileAtomically(out / report.name / "report.md", evaluation::Markdown(report, "..")));
  }
  return WriteFileAtomically(out / "sections.md", text);
}

std::string NamesForHelp() {
  std::string help = "all, or one of:";
  for (const Experiment& experiment : Experiments())
    absl::StrAppend(&help, "\n  ", experiment.name, ": ", experiment.summary);
  return help;
}

}  // namespace

void AddEvaluateCommand(CLI::App& app, std::function<absl::Status()>& run) {
  CLI::App* command =
      app.add_subcommand("evaluate", "Reruns the paper's experiments and writes what they found");
  const auto flags = std::make_shared<EvaluateFlags>();
  command->add_option("name", flags->name, NamesForHelp())->capture_default_str();
  command->add_option("--out", flags->out_dir, "Directory for reports and plots")->required();
  command->add_option("--data", flags->data_dir,
                      "Unpacked KITTI recordings; without, what needs them is skipped");
  command->add_option("--scale", flags->scale, "Share of the full size, to try out")
      ->check(CLI::Range(0.001, 1.0))
      ->capture_default_str();
  command->add_option("--threads", flags->threads, "Threads of the simulator")
      ->check(CLI::Range(1, 64))
      ->capture_default_str();
  command->add_option("--seed", flags->seed, "Of everything random")->capture_default_str();
  command->add_flag("--json", flags->json, "A report a line, for programs");
  command->callback([flags, &run] { run = [flags] { return Evaluate(*flags); }; });
}

}  // namespace gem::client
