#include "client/cli/top_command.h"

#include <CLI/CLI.hpp>
#include <chrono>
#include <cstdio>
#include <memory>
#include <string>
#include <thread>
#include <utility>

#include "client/cli/terminal.h"
#include "client/cli/top_rates.h"
#include "client/cli/top_screen.h"
#include "client/map_client.h"
#include "core/base/status_macros.h"

namespace gem::client {
namespace {

using Clock = std::chrono::steady_clock;

/// A server that does not answer must not keep us from hearing "q".
constexpr double kAnswer_s_max = 2;

struct TopFlags {
  std::string server = "127.0.0.1:50051";
  double interval_s = 1;
  bool once = false;
  bool json = false;
};

absl::StatusOr<TopSample> Look(const MapClient& client) {
  TopSample sample;
  GEM_ASSIGN_OR_RETURN(sample.status, client.GetServerStatus());
  GEM_ASSIGN_OR_RETURN(sample.maps, client.ListMaps());
  return sample;
}

std::unique_ptr<MapClient> ClientOf(const TopFlags& flags) {
  MapClientOptions options;
  options.deadline_s = kAnswer_s_max;
  return std::make_unique<MapClient>(
      std::make_shared<const Connection>(ConnectionOptions{flags.server}), options);
}

Clock::duration Interval(const TopFlags& flags) {
  return std::chrono::duration_cast<Clock::duration>(
      std::chrono::duration<double>(flags.interval_s));
}

/// Into a pipe or a file: frame after frame, or one.
absl::Status Print(const TopFlags& flags) {
  const std::unique_ptr<MapClient> client = ClientOf(flags);
  GEM_ASSIGN_OR_RETURN(TopSample before, Look(*client));
  do {
    std::this_thread::sleep_for(Interval(flags));
    GEM_ASSIGN_OR_RETURN(TopSample now, Look(*client));
    const TopRates rates = RatesBetween(before, now);
    const std::string text =
        flags.json ? TopJson(rates) : TopScreen(rates, {{}, false, flags.server, ""});
    std::fputs(text.c_str(), stdout);
    if (!flags.json && !flags.once) std::fputs("\n", stdout);
    // Whoever read has gone, and with them the reason to go on.
    if (std::fflush(stdout) != 0) return absl::OkStatus();
    before = std::move(now);
  } while (!flags.once);
  return absl::OkStatus();
}

/// On a terminal, until somebody quits. A server that is away is waited for.
absl::Status Show(const TopFlags& flags, Terminal& terminal) {
  const std::unique_ptr<MapClient> client = ClientOf(flags);
  TopSample before;
  TopRates rates;
  std::string notice = "connecting";
  const auto draw = [&] {
    terminal.Draw(TopScreen(rates, {terminal.size(), true, flags.server, notice}));
  };
  draw();
  while (true) {
    const Clock::time_point deadline = Clock::now() + Interval(flags);
    absl::StatusOr<TopSample> now = Look(*client);
    notice = now.ok() ? "" : std::string(now.status().message());
    if (now.ok()) {
      rates = RatesBetween(before, *now);
      before = *std::move(now);
    }
    draw();
    TerminalEvent event = TerminalEvent::kResized;
    while (event == TerminalEvent::kResized) {
      event = terminal.WaitUntil(deadline);
      if (event == TerminalEvent::kResized) draw();
    }
    if (event == TerminalEvent::kQuit) return absl::OkStatus();
  }
}

absl::Status RunTop(const TopFlags& flags) {
  // Before the first thread of gRPC.
  const std::unique_ptr<Terminal> terminal = flags.once || flags.json ? nullptr : Terminal::Open();
  return terminal == nullptr ? Print(flags) : Show(flags, *terminal);
}

}  // namespace

void AddTopCommand(CLI::App& app, std::function<absl::Status()>& run) {
  CLI::App* command = app.add_subcommand(
      "top",
      "What a server is doing: robots, stages, maps, calls. q quits; into a pipe, frame "
      "after frame");
  const auto flags = std::make_shared<TopFlags>();
  command->add_option("--server", flags->server, "Address of the server")->capture_default_str();
  command->add_option("--interval_s", flags->interval_s, "Between two looks, seconds")
      ->capture_default_str()
      ->check(CLI::Range(0.1, 3600.0));
  command->add_flag("--once", flags->once, "One frame, as text");
  command->add_flag("--json", flags->json, "For programs: an object a line");
  command->callback([flags, &run] { run = [flags] { return RunTop(*flags); }; });
}

}  // namespace gem::client
