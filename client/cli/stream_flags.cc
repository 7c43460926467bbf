#include "client/cli/stream_flags.h"

#include <CLI/CLI.hpp>
#include <algorithm>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "client/map_client.h"

namespace gem::client {
namespace {

/// A fifth of a LiDAR's noise along the beam, and fine enough for 131 m in 16 bits.
constexpr double kCompactStep_m = 4e-3;

}  // namespace

void AddStreamFlags(CLI::App& command, StreamFlags& flags) {
  command.add_option("--server", flags.server, "Address of the server")->capture_default_str();
  command.add_option("--map", flags.map, "Map to feed; created if it does not exist")
      ->capture_default_str();
  command.add_option("--robot", flags.robot, "Id of the robot")->capture_default_str();
  command.add_option("--session", flags.session,
                     "Id of the session; the id of an earlier one goes on where it stopped "
                     "(default: a new one)");
  command.add_flag("--json", flags.json, "The summary, for programs");
  command.add_option("--rate", flags.rate, "Scans a second, or max")->capture_default_str();
  command.add_option("--correct_at", flags.correct_at,
                     "Send the corrected poses of all scans so far after scan N[,N...], after "
                     "every scan, or at the end: N[,N...]|every|end");
  command.add_option("--scans", flags.scans, "Stop after so many scans")
      ->check(CLI::PositiveNumber);
  command
      .add_option("--encoding,--points", flags.encoding,
                  "How points travel: float32, int16 (in mm) or compact (4 mm, compressed; pixels "
                  "without loss)")
      ->capture_default_str();
  command
      .add_option("--overload", flags.overload,
                  "When scans come faster than they can be fused: block, or drop_oldest as a "
                  "live robot does")
      ->capture_default_str();
  command.add_option("--cell_size_m", flags.cell_size_m, "Edge of a cell of a new map");
  command.add_option("--submap_length_m", flags.submap_length_m, "Path of a submap of a new map");
  command.add_option("--local_size_m", flags.local_size_m, "Edge of the local map");
  command.add_option("--range_m_min", flags.range_m_min, "Nearer points are ignored");
  command.add_option("--range_m_max", flags.range_m_max, "Farther points are ignored");
  command.add_option("--height_m_min", flags.height_m_min,
                     "Points lower than this over the base are ignored");
  command.add_option("--height_m_max", flags.height_m_max,
                     "Points higher than this over the base are ignored");
  command
      .add_option("--body", flags.body,
                  "X0,Y0,Z0,X1,Y1,Z1: points in this box of the base are the robot itself")
      ->delimiter(',')
      ->expected(6)
      ->capture_default_str();
  command.add_flag("--traversable_only", flags.traversable_only,
                   "Submaps of a new map keep traversable cells only");
}

bool CorrectionPlan::IsDueAfter(std::uint64_t num_scans) const {
  return after_every_scan || std::binary_search(after_scans.begin(), after_scans.end(), num_scans);
}

absl::StatusOr<CorrectionPlan> ParseCorrectAt(const std::string& text, std::size_t num_scans) {
  CorrectionPlan plan;
  if (text.empty()) return plan;
  for (const absl::string_view word : absl::StrSplit(text, ',')) {
    std::uint64_t scan = 0;
    if (word == "end") {
      plan.at_end = true;
    } else if (word == "every") {
      plan.after_every_scan = true;
    } else if (absl::SimpleAtoi(word, &scan) && scan >= 1) {
      if (scan > num_scans)
        return absl::InvalidArgumentError(
            absl::StrCat("--correct_at ", scan, ": there are ", num_scans, " scans only"));
      plan.after_scans.push_back(scan);
    } else {
      return absl::InvalidArgumentError(
          absl::StrCat("--correct_at is \"", text, "\", want N[,N...], every or end"));
    }
  }
  std::sort(plan.after_scans.begin(), plan.after_scans.end());
  return plan;
}

absl::StatusOr<std::optional<double>> ParseRate(const std::string& text) {
  if (text == "max") return std::optional<double>();
  double rate_hz = 0;
  if (absl::SimpleAtod(text, &rate_hz) && rate_hz >= 1e-3 && rate_hz <= 1e6)
    return std::optional<double>(rate_hz);
  return absl::InvalidArgumentError(
      absl::StrCat("--rate is \"", text, "\", want max or scans a second in [0.001, 1e6]"));
}

absl::Status ParseEncoding(const std::string& text, IngestOptions& options) {
  if (text != "float32" && text != "int16" && text != "compact")
    return absl::InvalidArgumentError(
        absl::StrCat("--encoding is \"", text, "\", want float32, int16 or compact"));
  options.point_encoding = text == "float32" ? PointEncoding::kFloat32 : PointEncoding::kInt16;
  if (text == "compact") {
    options.int16_step_m = kCompactStep_m;
    options.compression = ScanCompression::kDeltaZstd;
  }
  return absl::OkStatus();
}

absl::StatusOr<OverloadPolicy> ParseOverload(const std::string& text) {
  if (text == "block") return OverloadPolicy::kBlock;
  if (text == "drop_oldest") return OverloadPolicy::kDropOldest;
  return absl::InvalidArgumentError(
      absl::StrCat("--overload is \"", text, "\", want block or drop_oldest"));
}

SessionSetup SetupOf(const StreamFlags& flags) {
  SessionSetup setup;
  setup.map = flags.map;
  setup.robot = flags.robot;
  setup.session = flags.session.empty() ? absl::StrCat("session-", UniqueId()) : flags.session;
  setup.cell_size_m = flags.cell_size_m;
  setup.submap_length_m = flags.submap_length_m;
  setup.side_m = flags.local_size_m;
  setup.range_m_min = flags.range_m_min;
  setup.range_m_max = flags.range_m_max;
  setup.height_m_min = flags.height_m_min;
  setup.height_m_max = flags.height_m_max;
  if (const std::vector<float>& b = flags.body; !b.empty())
    setup.body = Box{{b[0], b[1], b[2]}, {b[3], b[4], b[5]}};
  setup.traversable_only = flags.traversable_only;
  return setup;
}

}  // namespace gem::client
