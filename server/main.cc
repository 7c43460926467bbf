// gem_server: options, signals, and the line that says it is ready.
#include <CLI/CLI.hpp>
#include <csignal>
#include <cstdio>
#include <string>
#include <vector>

#include "server/server.h"
#include "server/settings.h"
#include "spdlog/sinks/stdout_sinks.h"
#include "spdlog/spdlog.h"

namespace {

/// 2 for what the operator got wrong, 1 for the rest.
int Fail(const absl::Status& status) {
  std::fprintf(stderr, "gem_server: %s\n", std::string(status.message()).c_str());
  return absl::IsInvalidArgument(status) ? 2 : 1;
}

struct FlagValue {
  const gem::Setting* setting = nullptr;
  std::string value;
  CLI::Option* option = nullptr;
};

/// File first, flags over it.
absl::Status Collect(const std::string& config, const std::vector<FlagValue>& flags,
                     gem::ServerOptions& options) {
  if (!config.empty()) {
    const absl::Status status = gem::ReadConfigFile(config, options);
    if (!status.ok()) return status;
  }
  for (const FlagValue& flag : flags) {
    if (flag.option->count() == 0) continue;
    const absl::Status status = flag.setting->set(flag.value, options);
    if (!status.ok()) return absl::InvalidArgumentError("--" + std::string(status.message()));
  }
  return gem::Validate(options);
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("GEM server: elevation maps of sites from the scans of robots.");
  std::string config, data_dir;
  app.add_option("--config", config, "YAML file with the options below; flags go over it");
  app.add_option("--data_dir", data_dir, "where maps are kept (not in this release)");
  const gem::ServerOptions defaults;
  std::vector<FlagValue> flags(gem::Settings().size());
  for (std::size_t i = 0; i < flags.size(); ++i) {
    const gem::Setting& setting = gem::Settings()[i];
    flags[i].setting = &setting;
    flags[i].option = app.add_option("--" + setting.name, flags[i].value, setting.help)
                          ->default_str(setting.get(defaults));
  }
  CLI11_PARSE(app, argc, argv);

  // Pretending to keep maps would be worse than refusing to.
  if (!data_dir.empty())
    return Fail(
        absl::InvalidArgumentError("--data_dir is " + data_dir +
                                   ", but this release keeps maps in memory only: leave it out"));
  gem::ServerOptions options;
  if (const absl::Status status = Collect(config, flags, options); !status.ok())
    return Fail(status);

  // Standard output is for the line that scripts wait for.
  spdlog::set_default_logger(spdlog::stderr_logger_mt("gem_server"));
  spdlog::set_level(spdlog::level::from_str(options.log_level));

  // Blocked before any thread exists, so that only sigwait() below gets them.
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGINT);
  sigaddset(&signals, SIGTERM);
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);

  absl::StatusOr<std::unique_ptr<gem::Server>> server = gem::Server::Start(options);
  if (!server.ok()) return Fail(server.status());
  std::printf("gem_server ready grpc=%s metrics=%s\n", (*server)->grpc_address().c_str(),
              (*server)->metrics_address().c_str());
  std::fflush(stdout);

  int signal = 0;
  sigwait(&signals, &signal);
  spdlog::info("signal {}: going away", signal);
  (*server)->Stop();
  return 0;
}
