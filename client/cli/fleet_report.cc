#include "client/cli/fleet_report.h"

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "client/cli/json.h"

namespace gem::client {
namespace {

std::string Texts(const std::vector<std::string>& texts) {
  return JsonArray(texts, [](const std::string& text) { return JsonText(text); });
}

template <typename A, typename B>
std::string PoseJson(const Pose<A, B>& pose) {
  const Eigen::Vector3d& t = pose.translation();
  const Eigen::Quaterniond& q = pose.rotation();
  return absl::StrFormat(
      "{\"x\":%.17g,\"y\":%.17g,\"z\":%.17g,\"qx\":%.17g,\"qy\":%.17g,\"qz\":%.17g,\"qw\":%.17g}",
      t.x(), t.y(), t.z(), q.x(), q.y(), q.z(), q.w());
}

std::string SessionJson(const SessionInfo& session) {
  return absl::StrCat(
      "{\"id\":", JsonText(session.id), ",\"robot\":", JsonText(session.robot),
      ",\"active\":", JsonBool(session.active), ",\"retracted\":", JsonBool(session.retracted),
      ",\"map_from_odom\":", PoseJson(session.T_G_O), ",\"num_submaps\":", session.num_submaps,
      ",\"num_points\":", session.num_points, "}");
}

std::string ExtentJson(const std::optional<Region>& extent) {
  if (!extent) return "null";
  return absl::StrCat("[", JsonNumber(extent->x_m_min), ",", JsonNumber(extent->y_m_min), ",",
                      JsonNumber(extent->x_m_max), ",", JsonNumber(extent->y_m_max), "]");
}

std::string SubmapJson(const SubmapInfo& submap) {
  return absl::StrCat(
      "{\"id\":", submap.id, ",\"session\":", JsonText(submap.session),
      ",\"sessions\":", Texts(submap.sessions), ",\"robots\":", Texts(submap.robots),
      ",\"map_from_submap\":", PoseJson(submap.T_G_K), ",\"extent_m\":", ExtentJson(submap.extent),
      ",\"anchor_stamp_ns\":", submap.anchor_stamp_ns, ",\"num_points\":", submap.num_points,
      ",\"first_stamp_ns\":", submap.first_stamp_ns, ",\"last_stamp_ns\":", submap.last_stamp_ns,
      ",\"finished\":", JsonBool(submap.finished), "}");
}

const char* StateOf(const SessionInfo& session) {
  if (session.retracted) return "retracted";
  return session.active ? "active" : "ended";
}

}  // namespace

std::string VersionJson(const MapVersion& version) {
  return absl::StrCat("\"epoch\":", version.epoch, ",\"revision\":", version.revision);
}

std::string MapJson(const MapInfo& map) {
  return absl::StrCat(
      "{\"id\":", JsonText(map.id), ",\"cell_size_m\":", JsonNumber(map.cell_size_m),
      ",\"submap_length_m\":", JsonNumber(map.submap_length_m),
      ",\"traversable_only\":", JsonBool(map.traversable_only), ",", VersionJson(map.version),
      ",\"num_submaps\":", map.num_submaps, ",\"num_points\":", map.num_points,
      ",\"submap_bytes\":", map.submap_bytes, ",\"num_tiles\":", map.num_tiles,
      ",\"num_sessions\":", map.num_sessions, ",\"sessions\":", Texts(map.sessions), "}");
}

std::string MapsTable(const std::vector<MapInfo>& maps) {
  std::string text =
      absl::StrFormat("%-20s %7s %9s %8s %8s %10s %9s %7s %12s\n", "map", "cell m", "submap m",
                      "sessions", "submaps", "points", "MiB", "tiles", "revision");
  for (const MapInfo& map : maps)
    absl::StrAppendFormat(&text, "%-20s %7.3g %9.4g %8d %8d %10d %9.2f %7d %12d\n", map.id,
                          map.cell_size_m, map.submap_length_m, map.num_sessions, map.num_submaps,
                          map.num_points, static_cast<double>(map.submap_bytes) / (1 << 20),
                          map.num_tiles, map.version.revision);
  return text;
}

std::string SessionsJson(const std::string& map, const std::vector<SessionInfo>& sessions) {
  return absl::StrCat("{\"map\":", JsonText(map),
                      ",\"sessions\":", JsonArray(sessions, SessionJson), "}\n");
}

std::string SessionsTable(const std::vector<SessionInfo>& sessions) {
  std::string text = absl::StrFormat("%-25s %-16s %-9s %8s %10s\n", "session", "robot", "state",
                                     "submaps", "points");
  for (const SessionInfo& session : sessions)
    absl::StrAppendFormat(&text, "%-25s %-16s %-9s %8d %10d\n", session.id, session.robot,
                          StateOf(session), session.num_submaps, session.num_points);
  return text;
}

std::string SubmapsJson(const std::string& map, const std::vector<SubmapInfo>& submaps) {
  return absl::StrCat("{\"map\":", JsonText(map), ",\"submaps\":", JsonArray(submaps, SubmapJson),
                      "}\n");
}

std::string SubmapsTable(const std::vector<SubmapInfo>& submaps) {
  std::string text = absl::StrFormat("%8s %-25s %10s %10s %8s %-8s %s\n", "submap", "session",
                                     "x m", "y m", "points", "state", "robots");
  for (const SubmapInfo& submap : submaps)
    absl::StrAppendFormat(&text, "%8d %-25s %10.2f %10.2f %8d %-8s %s\n", submap.id, submap.session,
                          submap.T_G_K.translation().x(), submap.T_G_K.translation().y(),
                          submap.num_points, submap.finished ? "finished" : "growing",
                          absl::StrJoin(submap.robots, ","));
  return text;
}

}  // namespace gem::client
