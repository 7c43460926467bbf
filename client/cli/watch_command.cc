#include "client/cli/watch_command.h"

#include <CLI/CLI.hpp>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/synchronization/notification.h"
#include "client/map_mirror.h"

namespace gem::client {
namespace {

/// The mirror waits for a server or a map that is not there; so does the command, and says so. It
/// looks this often.
constexpr double kLook_s = 1;

struct WatchFlags {
  std::string server = "127.0.0.1:50051";
  std::string map = "default";
  std::vector<double> region;  // empty or four
  int level = 0;
  double min_interval_s = 0;
  std::uint64_t bytes_per_s_max = 0;
  std::uint64_t num_versions = 0;
  bool json = false;
};

/// One line: a version and what it changed.
std::string Line(const MirroredMap& map, std::size_t num_changed, bool json) {
  if (json)
    return absl::StrCat("{\"epoch\":", map.version.epoch, ",\"revision\":", map.version.revision,
                        ",\"level\":", map.level, ",\"num_tiles\":", map.tiles.size(),
                        ",\"num_changed\":", num_changed, "}\n");
  return absl::StrFormat("version %d.%d: %d tiles, %d changed\n", map.version.epoch,
                         map.version.revision, map.tiles.size(), num_changed);
}

absl::Status Watch(const WatchFlags& flags) {
  MirrorOptions options;
  options.map = flags.map;
  if (!flags.region.empty())
    options.region = Region{flags.region[0], flags.region[1], flags.region[2], flags.region[3]};
  options.level = flags.level;
  options.min_interval_s = flags.min_interval_s;
  options.bytes_per_s_max = flags.bytes_per_s_max;
  absl::Notification enough;
  std::uint64_t num_printed = 0;  // the mirror's thread's own
  options.on_version = [&](const std::shared_ptr<const MirroredMap>& map,
                           const std::vector<TileIndex>& changed) {
    if (enough.HasBeenNotified()) return;
    std::fputs(Line(*map, changed.size(), flags.json).c_str(), stdout);
    std::fflush(stdout);
    if (++num_printed == flags.num_versions) enough.Notify();
  };
  const MapMirror mirror(std::make_shared<const Connection>(ConnectionOptions{flags.server}),
                         std::move(options));
  absl::Status told;
  while (!enough.WaitForNotificationWithTimeout(absl::Seconds(kLook_s))) {
    const MirrorStats stats = mirror.stats();
    if (stats.ended) return stats.error;
    const absl::Status error = stats.connected ? absl::OkStatus() : stats.error;
    if (!error.ok() && error != told)
      std::fprintf(stderr, "gem: waiting: %s\n", std::string(error.message()).c_str());
    told = error;
  }
  return absl::OkStatus();
}

}  // namespace

void AddWatchCommand(CLI::App& app, std::function<absl::Status()>& run) {
  CLI::App* command = app.add_subcommand(
      "watch", "Keep a map up to date and print one line a version, until interrupted");
  const auto flags = std::make_shared<WatchFlags>();
  command->add_option("--server", flags->server, "Address of the server")->capture_default_str();
  command->add_option("--map", flags->map, "Map to watch")->capture_default_str();
  command
      ->add_option("--region", flags->region,
                   "X0,Y0,X1,Y1: only tiles that it touches, metres of G")
      ->delimiter(',')
      ->expected(4);
  command->add_option("--level", flags->level, "Of the pyramid: each level halves the resolution")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  command->add_option("--min_interval_s", flags->min_interval_s, "Changes come at most this often")
      ->capture_default_str();
  command
      ->add_option("--bytes_per_s_max", flags->bytes_per_s_max,
                   "Bytes a second on average; 0: as many as the connection takes")
      ->capture_default_str();
  command->add_option("--versions", flags->num_versions, "Stop after so many; 0: never")
      ->capture_default_str();
  command->add_flag("--json", flags->json, "An object a line, for programs");
  command->callback([flags, &run] { run = [flags] { return Watch(*flags); }; });
}

}  // namespace gem::client
