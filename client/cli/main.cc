// gem: the command line of the mapping server.
//
// A command lives in client/cli/<name>_command.{h,cc} and adds itself to the app; its callback sets
// `run` to what it will do, so that parsing and doing stay apart.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <functional>
#include <string>

#include "absl/status/status.h"
#include "client/cli/commands.h"

int main(int argc, char** argv) {
  CLI::App app("Client of the GEM elevation mapping server");
  app.name("gem");
  app.require_subcommand(1);
  std::function<absl::Status()> run;
  int exit_code = 0;
  gem::client::AddCommands(app, run, exit_code);
  CLI11_PARSE(app, argc, argv);

  const absl::Status status = run();
  if (status.ok()) return exit_code;
  std::fprintf(stderr, "gem: %s\n", std::string(status.message()).c_str());
  return exit_code != 0 ? exit_code : 1;
}
