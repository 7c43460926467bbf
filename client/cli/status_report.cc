#include "client/cli/status_report.h"

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/cli/fleet_report.h"
#include "client/cli/json.h"

namespace gem::client {
namespace {

double MeanMs(const StageTiming& timing) {
  return timing.count == 0 ? 0 : timing.total_s / static_cast<double>(timing.count) * 1e3;
}

std::string SessionJson(const SessionStatus& session) {
  return absl::StrCat(
      "{\"map\":", JsonText(session.map), ",\"robot\":", JsonText(session.robot),
      ",\"session\":", JsonText(session.session), ",\"active\":", JsonBool(session.active),
      ",\"connected\":", JsonBool(session.connected),
      ",\"num_scans_fused\":", session.num_scans_fused,
      ",\"num_scans_refused\":", session.num_scans_refused,
      ",\"num_scans_dropped\":", session.num_scans_dropped,
      ",\"queue_bytes\":", session.queue_bytes, ",\"fused_seq\":", session.fused_seq, "}");
}

std::string TimingJson(const StageTiming& timing) {
  return absl::StrCat("{\"mapper\":", JsonText(timing.mapper),
                      ",\"stage\":", JsonText(timing.stage), ",\"count\":", timing.count,
                      ",\"mean_ms\":", JsonNumber(MeanMs(timing)),
                      ",\"max_ms\":", JsonNumber(timing.max_s * 1e3),
                      ",\"total_s\":", JsonNumber(timing.total_s), "}");
}

}  // namespace

std::string StatusTable(const ServerStatus& status, const std::vector<MapInfo>& maps) {
  std::string text = absl::StrFormat("gem_server %s, backend %s, up %.0f s\n\n",
                                     status.server_version, status.backend, status.uptime_s);
  absl::StrAppend(&text, MapsTable(maps));
  absl::StrAppendFormat(&text, "\n%-20s %-16s %-25s %-9s %8s %8s %8s %10s\n", "map", "robot",
                        "session", "state", "fused", "refused", "dropped", "queue KiB");
  for (const SessionStatus& session : status.sessions)
    absl::StrAppendFormat(
        &text, "%-20s %-16s %-25s %-9s %8d %8d %8d %10.1f\n", session.map, session.robot,
        session.session, !session.active ? "ended" : (session.connected ? "streaming" : "waiting"),
        session.num_scans_fused, session.num_scans_refused, session.num_scans_dropped,
        static_cast<double>(session.queue_bytes) / 1024);
  absl::StrAppendFormat(&text, "\n%-8s %-10s %10s %10s %10s\n", "mapper", "stage", "mean ms",
                        "max ms", "count");
  for (const StageTiming& timing : status.timings)
    absl::StrAppendFormat(&text, "%-8s %-10s %10.3f %10.3f %10d\n", timing.mapper, timing.stage,
                          MeanMs(timing), timing.max_s * 1e3, timing.count);
  return text;
}

std::string StatusJson(const ServerStatus& status, const std::vector<MapInfo>& maps) {
  return absl::StrCat("{\"server_version\":", JsonText(status.server_version),
                      ",\"backend\":", JsonText(status.backend),
                      ",\"uptime_s\":", JsonNumber(status.uptime_s),
                      ",\"maps\":", JsonArray(maps, MapJson),
                      ",\"sessions\":", JsonArray(status.sessions, SessionJson),
                      ",\"timings\":", JsonArray(status.timings, TimingJson), "}\n");
}

}  // namespace gem::client
