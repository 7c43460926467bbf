#include "client/cli/commands.h"

#include <CLI/CLI.hpp>

#include "client/cli/bench_corrections.h"
#include "client/cli/bench_encodings.h"
#include "client/cli/bench_local.h"
#include "client/cli/bench_serving.h"
#include "client/cli/bench_soak.h"
#include "client/cli/correct_command.h"
#include "client/cli/evaluate_command.h"
#include "client/cli/export_command.h"
#include "client/cli/local_command.h"
#include "client/cli/maps_command.h"
#include "client/cli/replay_command.h"
#include "client/cli/sessions_command.h"
#include "client/cli/simulate_command.h"
#include "client/cli/status_command.h"
#include "client/cli/submaps_command.h"
#include "client/cli/terrain_commands.h"
#include "client/cli/top_command.h"
#include "client/cli/watch_command.h"

namespace gem::client {

void AddCommands(CLI::App& app, std::function<absl::Status()>& run, int& exit_code) {
  AddReplayCommand(app, run);
  AddSimulateCommand(app, run);
  AddExportCommand(app, run);
  AddLocalCommand(app, run);
  AddMapsCommand(app, run);
  AddSessionsCommand(app, run);
  AddSubmapsCommand(app, run);
  AddStatusCommand(app, run);
  AddSampleCommand(app, run);
  AddCheckPathCommand(app, run, exit_code);
  AddTopCommand(app, run);
  AddWatchCommand(app, run);
  AddCorrectCommand(app, run);
  AddBenchCommand(app, run);
  AddBenchCorrectionsCommand(*app.get_subcommand("bench"), run);
  AddBenchEncodingsCommand(*app.get_subcommand("bench"), run);
  AddBenchServingCommand(*app.get_subcommand("bench"), run);
  AddBenchSoakCommand(*app.get_subcommand("bench"), run);
  AddEvaluateCommand(app, run);
}

}  // namespace gem::client
