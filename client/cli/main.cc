// gem: the command line of the mapping server.
//
// A command lives in client/cli/<name>_command.{h,cc} and adds itself to the app; its callback sets
// `run` to what it will do, so that parsing and doing stay apart.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <functional>
#include <string>

#include "absl/status/status.h"
#include "client/cli/bench_corrections.h"
#include "client/cli/bench_encodings.h"
#include "client/cli/bench_local.h"
#include "client/cli/bench_serving.h"
#include "client/cli/bench_soak.h"
#include "client/cli/correct_command.h"
#include "client/cli/evaluate_command.h"
#include "client/cli/export_command.h"
#include "client/cli/local_command.h"
#include "client/cli/replay_command.h"
#include "client/cli/simulate_command.h"
#include "client/cli/status_command.h"
#include "client/cli/terrain_commands.h"
#include "client/cli/top_command.h"
#include "client/cli/watch_command.h"

int main(int argc, char** argv) {
  CLI::App app("Client of the GEM elevation mapping server");
  app.name("gem");
  app.require_subcommand(1);
  std::function<absl::Status()> run;
  int exit_code = 0;  // commands that have more to say than that they worked
  gem::client::AddReplayCommand(app, run);
  gem::client::AddSimulateCommand(app, run);
  gem::client::AddExportCommand(app, run);
  gem::client::AddLocalCommand(app, run);
  gem::client::AddStatusCommand(app, run);
  gem::client::AddSampleCommand(app, run);
  gem::client::AddCheckPathCommand(app, run, exit_code);
  gem::client::AddTopCommand(app, run);
  gem::client::AddWatchCommand(app, run);
  gem::client::AddCorrectCommand(app, run);
  gem::client::AddBenchCommand(app, run);
  gem::client::AddBenchCorrectionsCommand(*app.get_subcommand("bench"), run);
  gem::client::AddBenchEncodingsCommand(*app.get_subcommand("bench"), run);
  gem::client::AddBenchServingCommand(*app.get_subcommand("bench"), run);
  gem::client::AddBenchSoakCommand(*app.get_subcommand("bench"), run);
  gem::client::AddEvaluateCommand(app, run);
  CLI11_PARSE(app, argc, argv);

  const absl::Status status = run();
  if (status.ok()) return exit_code;
  std::fprintf(stderr, "gem: %s\n", std::string(status.message()).c_str());
  return exit_code != 0 ? exit_code : 1;
}
