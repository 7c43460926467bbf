#include "server/registry.h"

#include <algorithm>
#include <string>

#include "absl/strings/str_cat.h"
#include "core/base/status_macros.h"
#include "proto/wire/refusal.h"
#include "server/retry.h"
#include "spdlog/spdlog.h"

namespace gem {
namespace {

constexpr double kRetryAfter_s = 5;

/// Core names its own options ("map.cell_size_m is ..."): the robot must read its field.
absl::Status UnderOpen(const absl::Status& status, const std::string& prefix,
                       const std::string& field_prefix) {
  std::string text(status.message());
  if (text.rfind(prefix, 0) == 0) text = field_prefix + text.substr(prefix.size());
  const std::string field = text.substr(0, text.find(' '));
  return wire::WithField(absl::InvalidArgumentError(text), field);
}

absl::Status HasEnded(const std::string& session) {
  return wire::WithField(absl::FailedPreconditionError(absl::StrCat(
                             "open.session is ", session, ", which has ended, want a new id")),
                         "open.session");
}

wire::PoseCovariance DefaultCovariance(const ServerOptions& options) {
  const double rotation = options.pose_sigma_rotation_rad;
  const double translation = options.pose_sigma_translation_m;
  return {translation * translation * Eigen::Matrix3d::Identity(),
          rotation * rotation * Eigen::Matrix3d::Identity()};
}

MapActorOptions MapActorOptionsOf(const ServerOptions& options) {
  return {options.publish_hz,
          options.sessions_per_map_max,
          options.finished_submaps_waiting_max,
          options.corrections_waiting_max,
          options.request_ids_max,
          options.commit_restarts_max,
          {.retention_s = options.revision_retention_s, .bytes_max = options.revision_bytes_max}};
}

SessionActorOptions SessionActorOptionsOf(const ServerOptions& options) {
  return {options.queue_bytes_max,    options.publish_hz,      options.local_publish_hz,
          options.session_idle_s_max, options.pose_wait_s_max, options.waiting_scans_max};
}

}  // namespace

Registry::Registry(const ServerOptions& options, std::uint64_t epoch, Metrics& metrics)
    : options_(options), epoch_(epoch), metrics_(metrics) {}

Registry::~Registry() { Stop(); }

absl::StatusOr<std::shared_ptr<SessionActor>> Registry::OpenSession(
    const wire::SessionSetup& setup) {
  // Destroyed after the lock is released: that joins threads.
  std::vector<std::shared_ptr<SessionActor>> forgotten;
  MutexLock lock(mutex_);
  if (stopped_) return absl::UnavailableError("the server is going away");
  const auto found = sessions_.find(SessionKey(setup.map, setup.session));
  if (found == sessions_.end()) {
    forgotten = ForgetLocked();
    return AddSessionLocked(setup);
  }
  const SessionActor& session = *found->second;
  if (!session.active()) return HasEnded(setup.session);
  const std::string& robot = session.config().setup.robot;
  if (robot != setup.robot)
    return wire::WithField(
        absl::FailedPreconditionError(absl::StrCat("open.robot is ", setup.robot, ", want ", robot,
                                                   ", whose session ", setup.session, " is")),
        "open.robot");
  GEM_RETURN_IF_ERROR(setup.map_setup.CheckAgainst(session.map()->options()));
  return found->second;
}

absl::StatusOr<std::shared_ptr<SessionActor>> Registry::AddSessionLocked(
    const wire::SessionSetup& setup) {
  const auto num_active = std::count_if(by_age_.begin(), by_age_.end(),
                                        [](const auto& session) { return session->active(); });
  if (num_active >= options_.sessions_max)
    return WithRetry(absl::ResourceExhaustedError(absl::StrCat(
                         num_active, " sessions are open, want at most ", options_.sessions_max)),
                     kRetryAfter_s);
  absl::StatusOr<std::shared_ptr<MapActor>> map = FindOrAddMapLocked(setup);
  if (!map.ok()) return map.status();

  SessionConfig config;
  config.setup = setup;
  config.backend = options_.backend;
  config.local_threads = options_.local_threads;
  config.local_map = setup.local_map.Over(options_.local_map);
  config.local_map.cell_size_m = (*map)->options().cell_size_m;
  config.local_map.traversability_free = (*map)->options().traversability_free;
  config.map = (*map)->options();
  config.scan_limits = {options_.scan_bytes_max, options_.points_max};
  config.default_covariance = DefaultCovariance(options_);
  if (const absl::Status status = Validate(config.local_map); !status.ok())
    return UnderOpen(status, "local_map.", "open.local_map.");

  const absl::Status added = (*map)->AddSession(setup.session, setup.robot, setup.T_G_O);
  if (absl::IsAlreadyExists(added)) return HasEnded(setup.session);
  GEM_RETURN_IF_ERROR(added);
  maps_.try_emplace(setup.map, *map);
  auto session = std::make_shared<SessionActor>(std::move(config), *map,
                                                SessionActorOptionsOf(options_), metrics_);
  sessions_[SessionKey(setup.map, setup.session)] = session;
  by_age_.push_back(session);
  std::shared_ptr<SessionActor>& newest = robots_[setup.robot];
  if (newest != nullptr && !newest->active()) newest->DropLocalMap();
  newest = session;
  spdlog::info("session {} of robot {} opened in map {}", setup.session, setup.robot, setup.map);
  return session;
}

absl::StatusOr<std::shared_ptr<MapActor>> Registry::FindOrAddMapLocked(
    const wire::SessionSetup& setup) {
  const auto found = maps_.find(setup.map);
  if (found != maps_.end()) {
    GEM_RETURN_IF_ERROR(setup.map_setup.CheckAgainst(found->second->options()));
    return found->second;
  }
  if (maps_.size() >= static_cast<std::size_t>(options_.maps_max))
    return absl::ResourceExhaustedError(
        absl::StrCat("there are ", maps_.size(), " maps, want at most ", options_.maps_max));
  const GlobalMapOptions map_options = setup.map_setup.Over(options_.map);
  if (const absl::Status status = Validate(map_options); !status.ok())
    return UnderOpen(status, "map.", "open.map_setup.");
  // Entered into the books only when its first session is: a refused one leaves no map behind.
  return std::make_shared<MapActor>(setup.map, map_options, epoch_, MapActorOptionsOf(options_),
                                    metrics_);
}

std::vector<std::shared_ptr<SessionActor>> Registry::ForgetLocked() {
  std::vector<std::shared_ptr<SessionActor>> forgotten;
  auto num_ended = std::count_if(by_age_.begin(), by_age_.end(),
                                 [](const auto& session) { return !session->active(); });
  for (auto it = by_age_.begin(); it != by_age_.end() && num_ended > options_.ended_sessions_max;) {
    if ((*it)->active()) {
      ++it;
      continue;
    }
    const wire::SessionSetup& setup = (*it)->config().setup;
    sessions_.erase(SessionKey(setup.map, setup.session));
    const auto robot = robots_.find(setup.robot);
    if (robot != robots_.end() && robot->second == *it) robots_.erase(robot);
    forgotten.push_back(std::move(*it));
    it = by_age_.erase(it);
    --num_ended;
  }
  return forgotten;
}

std::shared_ptr<SessionActor> Registry::FindSession(const wire::SessionSetup& setup) const {
  MutexLock lock(mutex_);
  const auto found = sessions_.find(SessionKey(setup.map, setup.session));
  const bool is_own =
      found != sessions_.end() && found->second->config().setup.robot == setup.robot;
  return is_own ? found->second : nullptr;
}

absl::StatusOr<std::shared_ptr<MapActor>> Registry::FindMap(const std::string& map) const {
  MutexLock lock(mutex_);
  const auto found = maps_.find(map);
  if (found != maps_.end()) return found->second;
  return wire::WithField(
      absl::NotFoundError(absl::StrCat("map is ", map, ", want an existing map")), "map");
}

absl::StatusOr<std::shared_ptr<SessionActor>> Registry::FindRobot(const std::string& robot) const {
  MutexLock lock(mutex_);
  const auto found = robots_.find(robot);
  if (found != robots_.end()) return found->second;
  return wire::WithField(
      absl::NotFoundError(absl::StrCat("robot is ", robot, ", want a robot that had a session")),
      "robot");
}

std::vector<std::shared_ptr<MapActor>> Registry::Maps() const {
  MutexLock lock(mutex_);
  std::vector<std::shared_ptr<MapActor>> maps;
  for (const auto& [id, map] : maps_) maps.push_back(map);
  return maps;
}

std::vector<std::shared_ptr<SessionActor>> Registry::Sessions() const {
  MutexLock lock(mutex_);
  return {by_age_.rbegin(), by_age_.rend()};
}

void Registry::Stop() {
  std::vector<std::shared_ptr<SessionActor>> sessions;
  std::vector<std::shared_ptr<MapActor>> maps;
  {
    MutexLock lock(mutex_);
    stopped_ = true;
    sessions.assign(by_age_.begin(), by_age_.end());
    for (const auto& [id, map] : maps_) maps.push_back(map);
  }
  for (const auto& session : sessions) session->Stop();
  for (const auto& map : maps) map->Stop();
}

}  // namespace gem
