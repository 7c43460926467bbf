#include "client/cli/bench_serving.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <memory>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/cli/json.h"
#include "client/cli/stream_flags.h"
#include "client/datasets/kitti_source.h"
#include "client/load/bare_server.h"
#include "client/simulation/scenes.h"
#include "core/base/status_macros.h"

namespace gem::client {
namespace {

using load::IngestRate;
using load::IngestResult;
using load::Milliseconds;
using load::ReadingBench;
using load::ReadResult;
using load::ScanTape;

/// Enough for the tape not to fit into any cache.
constexpr std::size_t kScansOfTape_max = 24;
/// As many points as an HDL-64 gives in the block's street.
constexpr int kAzimuths = 2250;

struct ServingFlags {
  std::string dir;
  std::string poses;
  std::vector<std::string> parts = {"ingest", "reading", "watching"};
  std::vector<std::string> encodings = {"float32", "int16", "compact"};
  std::vector<int> streams = {1, 4};
  std::vector<int> watchers = {0, 10, 100};
  load::ServingOptions options;
  bool json = false;
};

absl::StatusOr<std::unique_ptr<ScanSource>> OpenSource(const ServingFlags& flags) {
  if (!flags.dir.empty()) {
    KittiOptions kitti;
    kitti.dir = flags.dir;
    kitti.poses = flags.poses;
    return KittiSource::Open(kitti);
  }
  SceneOptions scene;
  scene.azimuths = kAzimuths;
  scene.scans_max = static_cast<int>(kScansOfTape_max);
  return MakeScene(scene);
}

absl::StatusOr<std::unique_ptr<const ScanTape>> RecordTape(const ServingFlags& flags,
                                                           const std::string& encoding) {
  IngestOptions options;
  GEM_RETURN_IF_ERROR(ParseEncoding(encoding, options));
  GEM_ASSIGN_OR_RETURN(const std::unique_ptr<ScanSource> source, OpenSource(flags));
  return ScanTape::Record(*source, options, kScansOfTape_max);
}

bool IsWanted(const ServingFlags& flags, const std::string& part) {
  return std::find(flags.parts.begin(), flags.parts.end(), part) != flags.parts.end();
}

absl::Status RunServing(const ServingFlags& flags) {
  ServingReport report;
  for (const std::string& encoding : flags.encodings) {
    GEM_ASSIGN_OR_RETURN(const std::unique_ptr<const ScanTape> tape, RecordTape(flags, encoding));
    report.scans = absl::StrCat(tape->name(), ", ", tape->num_scans(), " scans");
    report.points_per_scan = tape->mean_points();
    for (const int num_streams : flags.streams) {
      if (!IsWanted(flags, "ingest")) break;
      GEM_ASSIGN_OR_RETURN(const IngestResult ingest,
                           BenchIngest(*tape, encoding, num_streams, flags.options));
      report.ingest.push_back(ingest);
    }
    if (!IsWanted(flags, "reading") || !report.reading.empty()) continue;
    GEM_ASSIGN_OR_RETURN(ReadingBench reading, BenchReading(*tape, flags.options));
    report.reading.push_back(std::move(reading));
  }
  if (IsWanted(flags, "watching")) {
    GEM_ASSIGN_OR_RETURN(const std::unique_ptr<const ScanTape> tape,
                         RecordTape(flags, flags.encodings.front()));
    for (const int num_watchers : flags.watchers) {
      GEM_ASSIGN_OR_RETURN(const load::WatchResult watch,
                           load::BenchWatching(*tape, num_watchers, flags.options));
      report.watching.push_back(watch);
    }
  }
  std::fputs((flags.json ? ServingJson(report) : ServingTable(report)).c_str(), stdout);
  return absl::OkStatus();
}

std::string Json(const Milliseconds& ms) {
  return absl::StrCat("{\"p50\":", JsonNumber(ms.p50), ",\"p99\":", JsonNumber(ms.p99),
                      ",\"max\":", JsonNumber(ms.max), "}");
}

std::string Json(const IngestRate& rate) {
  return absl::StrCat("{\"scans_hz\":", JsonNumber(rate.scans_hz),
                      ",\"share\":", JsonNumber(rate.share),
                      ",\"cpu_ms\":", JsonNumber(rate.cpu_ms), "}");
}

std::string Json(const IngestResult& ingest) {
  return absl::StrCat(
      "{\"encoding\":", JsonText(ingest.encoding), ",\"num_streams\":", ingest.num_streams,
      ",\"bytes_per_scan\":", JsonNumber(ingest.bytes_per_scan), ",\"bare\":", Json(ingest.bare),
      ",\"taken\":", Json(ingest.taken), ",\"mapped\":", Json(ingest.mapped), "}");
}

std::string Json(const ReadResult& read) {
  return absl::StrCat(
      "{\"num_robots\":", read.robots.num_robots, ",\"tiles_per_call\":", read.tiles_per_call,
      ",\"calls_hz\":", JsonNumber(read.calls_hz), ",\"tiles_hz\":", JsonNumber(read.tiles_hz),
      ",\"bytes_hz\":", JsonNumber(read.bytes_hz), ",\"call_ms\":", Json(read.call),
      ",\"num_scans\":", read.robots.num_scans, ",\"num_late\":", read.robots.num_late,
      ",\"num_refused\":", read.robots.num_refused, ",\"scan_ms\":", Json(read.robots.scan),
      ",\"server_cores\":", JsonNumber(read.server_cores),
      ",\"load_cores\":", JsonNumber(read.load_cores), "}");
}

std::string Json(const load::WatchResult& watch) {
  return absl::StrCat(
      "{\"num_watchers\":", watch.num_watchers, ",\"num_silent\":", watch.num_silent,
      ",\"messages_hz\":", JsonNumber(watch.messages_hz),
      ",\"bytes_hz\":", JsonNumber(watch.bytes_hz),
      ",\"median_bytes\":", JsonNumber(watch.median_bytes),
      ",\"growth_bytes\":", JsonNumber(watch.growth_bytes),
      ",\"max_bytes\":", JsonNumber(watch.max_bytes), ",\"num_scans\":", watch.robots.num_scans,
      ",\"num_late\":", watch.robots.num_late, "}");
}

std::string Json(const ReadingBench& reading) {
  const auto to_json = [](const ReadResult& read) { return Json(read); };
  return absl::StrCat("{\"num_tiles\":", reading.num_tiles,
                      ",\"robots_sustained\":", reading.robots_sustained,
                      ",\"paced\":", JsonArray(reading.paced, to_json),
                      ",\"flooded\":", JsonArray(reading.flooded, to_json), "}");
}

void AppendIngest(const std::vector<IngestResult>& results, std::string& table) {
  absl::StrAppendFormat(&table, "\n%-9s %7s %8s %8s %8s %6s %9s %6s %8s %8s %8s\n", "ingest",
                        "streams", "MB/scan", "bare/s", "taken/s", "share", "mapped/s", "share",
                        "bare ms", "taken ms", "map'd ms");
  for (const IngestResult& r : results)
    absl::StrAppendFormat(&table,
                          "%-9s %7d %8.2f %8.0f %8.0f %5.0f%% %9.0f %5.0f%% %8.2f %8.2f %8.2f\n",
                          r.encoding, r.num_streams, r.bytes_per_scan / 1e6, r.bare.scans_hz,
                          r.taken.scans_hz, r.taken.share * 100, r.mapped.scans_hz,
                          r.mapped.share * 100, r.bare.cpu_ms, r.taken.cpu_ms, r.mapped.cpu_ms);
  table +=
      "bare: a gRPC stream that reads, parses and acknowledges. taken: by the server, decoded, and "
      "refused for want of a\npose. mapped: fused into local maps and the global map. ms: "
      "processor "
      "time of the receiver, a scan.\n";
}

void AppendReading(const std::string& name, const std::vector<ReadResult>& results,
                   std::string& table) {
  absl::StrAppendFormat(&table, "\n%-8s %7s %6s %8s %9s %8s %8s %7s %6s %8s %9s %9s %7s %7s\n",
                        name, "robots", "batch", "calls/s", "tiles/s", "p50 ms", "p99 ms", "scans",
                        "late", "refused", "scan p50", "scan p99", "server", "load");
  for (const ReadResult& r : results)
    absl::StrAppendFormat(
        &table, "%-8s %7d %6d %8.0f %9.0f %8.2f %8.2f %7d %6d %8d %9.1f %9.1f %7.2f %7.2f\n", "",
        r.robots.num_robots, r.tiles_per_call, r.calls_hz, r.tiles_hz, r.call.p50, r.call.p99,
        r.robots.num_scans, r.robots.num_late, r.robots.num_refused, r.robots.scan.p50,
        r.robots.scan.p99, r.server_cores, r.load_cores);
}

void AppendWatching(const std::vector<load::WatchResult>& results, std::string& table) {
  absl::StrAppendFormat(&table, "\n%-9s %6s %11s %9s %11s %11s %8s %6s %6s\n", "watchers", "silent",
                        "messages/s", "MB/s", "memory MiB", "growth MiB", "max MiB", "scans",
                        "late");
  const auto mib = [](double bytes) { return bytes / (1 << 20); };
  for (const load::WatchResult& r : results)
    absl::StrAppendFormat(&table, "%-9d %6d %11.1f %9.2f %11.1f %+11.2f %8.1f %6d %6d\n",
                          r.num_watchers, r.num_silent, r.messages_hz, r.bytes_hz / 1e6,
                          mib(r.median_bytes), mib(r.growth_bytes), mib(r.max_bytes),
                          r.robots.num_scans, r.robots.num_late);
}

}  // namespace

std::string ServingTable(const ServingReport& report) {
  std::string table =
      absl::StrFormat("%s, %.0f points each\n", report.scans, report.points_per_scan);
  if (!report.ingest.empty()) AppendIngest(report.ingest, table);
  for (const ReadingBench& reading : report.reading) {
    AppendReading("paced", reading.paced, table);
    AppendReading("flooded", reading.flooded, table);
    absl::StrAppendFormat(&table,
                          "\n%d robots at 10 Hz are sustained: 99 %% of their scans within 100 ms, "
                          "none refused. %d tiles are read.\n",
                          reading.robots_sustained, reading.num_tiles);
  }
  if (!report.watching.empty()) AppendWatching(report.watching, table);
  return table;
}

std::string ServingJson(const ServingReport& report) {
  return absl::StrCat(
      "{\"scans\":", JsonText(report.scans),
      ",\"points_per_scan\":", JsonNumber(report.points_per_scan), ",\"ingest\":",
      JsonArray(report.ingest, [](const IngestResult& ingest) { return Json(ingest); }),
      ",\"reading\":",
      JsonArray(report.reading, [](const ReadingBench& reading) { return Json(reading); }),
      ",\"watching\":",
      JsonArray(report.watching, [](const load::WatchResult& watch) { return Json(watch); }),
      "}\n");
}

void AddBenchServingCommand(CLI::App& bench, std::function<absl::Status()>& run) {
  CLI::App* serving = bench.add_subcommand(
      "serving",
      "A server of its own under load: scans taken in, and tiles read while robots stream");
  const auto flags = std::make_shared<ServingFlags>();
  serving->add_option("DIR", flags->dir,
                      "KITTI directory with the scans to send (default: simulated ones)");
  serving->add_option("--poses", flags->poses,
                      "Poses, relative to DIR (default: poses.txt, or the only poses*.txt)");
  serving->add_option("--parts", flags->parts, "Some of ingest, reading, watching")
      ->capture_default_str()
      ->delimiter(',')
      ->check(CLI::IsMember({"ingest", "reading", "watching"}));
  serving
      ->add_option("--encodings", flags->encodings,
                   "Of ingest; robots beside readers use the first")
      ->capture_default_str()
      ->delimiter(',');
  serving->add_option("--streams", flags->streams, "Of ingest at once")
      ->capture_default_str()
      ->delimiter(',')
      ->check(CLI::Range(1, 64));
  serving->add_option("--watchers", flags->watchers, "Of a map at once; the last never reads")
      ->capture_default_str()
      ->delimiter(',')
      ->check(CLI::Range(0, 1000));
  load::ServingOptions& options = flags->options;
  serving->add_option("--robots", options.robots_max, "Most robots that are tried")
      ->capture_default_str()
      ->check(CLI::Range(1, 64));
  serving->add_option("--seconds", options.seconds, "Of one measurement with robots")
      ->capture_default_str()
      ->check(CLI::Range(0.5, 600.0));
  serving->add_option("--watch_s", options.watch_s, "Of one measurement with watchers")
      ->capture_default_str()
      ->check(CLI::Range(0.5, 3600.0));
  serving->add_option("--rounds", options.rounds, "Of ingest")
      ->capture_default_str()
      ->check(CLI::Range(1, 100));
  serving->add_flag("--json", flags->json, "For programs");
  serving->callback([flags, &run] { run = [flags] { return RunServing(*flags); }; });

  // What the one above starts to compare with.
  CLI::App* bare = bench.add_subcommand("bare_server", "");
  bare->group("");
  bare->callback([&run] { run = [] { return load::RunBareServer("127.0.0.1:0"); }; });
}

}  // namespace gem::client
