#include "client/cli/terrain_commands.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "client/cli/terrain_report.h"
#include "client/map_client.h"
#include "core/base/status_macros.h"

namespace gem::client {
namespace {

/// What both commands ask for.
struct MapFlags {
  std::string server = "127.0.0.1:50051";
  std::string map = "default";
  bool json = false;
};

struct SampleFlags {
  MapFlags map;
  std::vector<std::string> points;
};

struct PathFlags {
  MapFlags map;
  std::vector<std::string> path;
  std::optional<double> radius_m;
  std::vector<double> rectangle;  // empty or four
  double step_m = 0;
};

void AddMapFlags(CLI::App& command, MapFlags& flags) {
  command.add_option("--server", flags.server, "Address of the server")->capture_default_str();
  command.add_option("--map", flags.map, "Map to ask")->capture_default_str();
  command.add_flag("--json", flags.json, "For programs");
}

absl::StatusOr<std::vector<Place>> ParsePlaces(absl::string_view option,
                                               const std::vector<std::string>& texts) {
  std::vector<Place> places;
  for (const std::string& text : texts) {
    GEM_ASSIGN_OR_RETURN(const Place place, ParsePlace(option, text));
    places.push_back(place);
  }
  return places;
}

MapClient ClientOf(const MapFlags& flags) {
  return MapClient(std::make_shared<const Connection>(ConnectionOptions{flags.server}));
}

absl::Status Sample(const SampleFlags& flags) {
  GEM_ASSIGN_OR_RETURN(const std::vector<Place> points, ParsePlaces("POINTS", flags.points));
  GEM_ASSIGN_OR_RETURN(const GroundHeights heights,
                       ClientOf(flags.map).SampleHeights(flags.map.map, points));
  std::fputs(
      (flags.map.json ? HeightsJson(points, heights) : HeightsTable(points, heights)).c_str(),
      stdout);
  return absl::OkStatus();
}

absl::StatusOr<Footprint> FootprintOf(const PathFlags& flags) {
  if (flags.radius_m.has_value() != flags.rectangle.empty())
    return absl::InvalidArgumentError("want either --radius_m or --rectangle");
  if (flags.radius_m) return Disc{*flags.radius_m};
  const std::vector<double>& r = flags.rectangle;
  return Rectangle{r[0], r[1], r[2], r[3]};
}

absl::StatusOr<bool> CheckPath(const PathFlags& flags) {
  PathQuestion question;
  GEM_ASSIGN_OR_RETURN(question.path, ParsePlaces("--path", flags.path));
  GEM_ASSIGN_OR_RETURN(question.footprint, FootprintOf(flags));
  question.step_m = flags.step_m;
  GEM_ASSIGN_OR_RETURN(const CheckedPath path,
                       ClientOf(flags.map).CheckPath(flags.map.map, question));
  std::fputs((flags.map.json ? PathJson(path) : PathText(path)).c_str(), stdout);
  return path.check.free;
}

}  // namespace

void AddSampleCommand(CLI::App& app, std::function<absl::Status()>& run) {
  CLI::App* command = app.add_subcommand("sample", "Height, slope and traversability at points");
  const auto flags = std::make_shared<SampleFlags>();
  AddMapFlags(*command, flags->map);
  command->add_option("POINTS", flags->points, "X,Y ...: metres of G")->required();
  command->callback([flags, &run] { run = [flags] { return Sample(*flags); }; });
}

void AddCheckPathCommand(CLI::App& app, std::function<absl::Status()>& run, int& exit_code) {
  CLI::App* command = app.add_subcommand(
      "check-path", "Whether a robot can follow a path; exits with 0 if it is free, 1 if not");
  const auto flags = std::make_shared<PathFlags>();
  AddMapFlags(*command, flags->map);
  command->add_option("--path", flags->path, "X,Y ...: corners, metres of G")->required();
  command->add_option("--radius_m", flags->radius_m, "The robot is a disc about B");
  command
      ->add_option("--rectangle", flags->rectangle,
                   "XMIN,YMIN,XMAX,YMAX: the robot is a rectangle in B, x along the path, m")
      ->delimiter(',')
      ->expected(4);
  command->add_option("--step_m", flags->step_m, "Samples lie at most so far apart; 0: a cell")
      ->capture_default_str();
  command->callback([flags, &run, &exit_code] {
    run = [flags, &exit_code] {
      const absl::StatusOr<bool> free = CheckPath(*flags);
      exit_code = !free.ok() ? 2 : (*free ? 0 : 1);
      return free.status();
    };
  });
}

}  // namespace gem::client
