#include "server/registry.h"

#include <algorithm>
#include <string>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/string_view.h"
#include "core/base/status_macros.h"
#include "proto/wire/refusal.h"
#include "server/retry.h"
#include "spdlog/spdlog.h"

namespace gem {
namespace {

constexpr double kRetryAfter_s = 5;
/// Sessions that a refusal lists by name.
constexpr std::size_t kSessionsNamed_max = 10;

/// Core names its own options ("map.cell_size_m is ..."): the caller must read its field.
absl::Status UnderRequest(const absl::Status& status, const std::string& prefix,
                          const std::string& field_prefix) {
  std::string text(status.message());
  if (text.rfind(prefix, 0) == 0) text = field_prefix + text.substr(prefix.size());
  const std::string field = text.substr(0, text.find(' '));
  return wire::WithField(absl::InvalidArgumentError(text), field);
}

absl::Status HasEnded(const std::string& session, const char* how = "has ended") {
  return wire::WithField(absl::FailedPreconditionError(absl::StrCat(
                             "open.session is ", session, ", which ", how, ", want a new id")),
                         "open.session");
}

absl::Status GoingAway() { return absl::UnavailableError("the server is going away"); }

wire::PoseCovariance DefaultCovariance(const ServerOptions& options) {
  const double rotation = options.pose_sigma_rotation_rad;
  const double translation = options.pose_sigma_translation_m;
  return {translation * translation * Eigen::Matrix3d::Identity(),
          rotation * rotation * Eigen::Matrix3d::Identity()};
}

MapActorOptions MapActorOptionsOf(const ServerOptions& options, NewsListener* news) {
  return {options.publish_hz,
          options.sessions_per_map_max,
          options.finished_submaps_waiting_max,
          options.corrections_waiting_max,
          options.request_ids_max,
          options.commit_restarts_max,
          {.retention_s = options.revision_retention_s,
           .bytes_max = options.revision_bytes_max,
           .listener = news}};
}

SessionActorOptions SessionActorOptionsOf(const ServerOptions& options) {
  return {options.queue_bytes_max,    options.publish_hz,      options.local_publish_hz,
          options.session_idle_s_max, options.pose_wait_s_max, options.waiting_scans_max,
          options.overload_age_s_max};
}

}  // namespace

Registry::Registry(const ServerOptions& options, std::uint64_t epoch, Metrics& metrics,
                   NewsListener* news)
    : options_(options),
      metrics_(metrics),
      news_(news),
      ingest_budget_(options.ingest_bytes_max, options.scan_bytes_max),
      next_epoch_(epoch),
      made_(static_cast<std::size_t>(options.request_ids_max)),
      deleted_(static_cast<std::size_t>(options.request_ids_max)),
      cut_off_(static_cast<std::size_t>(options.request_ids_max)) {}

Registry::~Registry() { Stop(); }

absl::StatusOr<std::shared_ptr<SessionActor>> Registry::OpenSession(
    const wire::SessionSetup& setup) {
  // Destroyed after the lock is released: that joins threads.
  std::vector<std::shared_ptr<SessionActor>> forgotten;
  MutexLock lock(mutex_);
  if (stopped_) return GoingAway();
  const auto found = sessions_.find(SessionKey(setup.map, setup.session));
  if (found == sessions_.end()) {
    if (cut_off_.Find(setup.map, setup.session) != nullptr)
      return HasEnded(setup.session, "ended when its map was deleted");
    forgotten = ForgetEndedLocked();
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
  absl::StatusOr<std::shared_ptr<MapActor>> map = FindOrMakeMapLocked(setup);
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
    return UnderRequest(status, "local_map.", "open.local_map.");

  const absl::Status added = (*map)->AddSession(setup.session, setup.robot, setup.T_G_O);
  if (absl::IsAlreadyExists(added)) return HasEnded(setup.session);
  GEM_RETURN_IF_ERROR(added);
  maps_.try_emplace(setup.map, *map);
  auto session =
      std::make_shared<SessionActor>(std::move(config), *map, FeedOfLocked(setup.robot),
                                     SessionActorOptionsOf(options_), ingest_budget_, metrics_);
  sessions_[SessionKey(setup.map, setup.session)] = session;
  by_age_.push_back(session);
  robots_[setup.robot] = session;
  spdlog::info("session {} of robot {} opened in map {}", setup.session, setup.robot, setup.map);
  return session;
}

absl::StatusOr<std::shared_ptr<MapActor>> Registry::FindOrMakeMapLocked(
    const wire::SessionSetup& setup) {
  const auto found = maps_.find(setup.map);
  // Entered into the books only when its first session is: a refused one leaves no map behind.
  if (found == maps_.end()) return MakeMapLocked(setup.map, setup.map_setup, "open.map_setup.");
  GEM_RETURN_IF_ERROR(setup.map_setup.CheckAgainst(found->second->options()));
  return found->second;
}

absl::StatusOr<std::shared_ptr<MapActor>> Registry::MakeMapLocked(const std::string& map,
                                                                  const wire::MapSetup& setup,
                                                                  const std::string& field) {
  GEM_RETURN_IF_ERROR(CheckRoomLocked());
  const GlobalMapOptions map_options = setup.Over(options_.map);
  if (const absl::Status status = Validate(map_options); !status.ok())
    return UnderRequest(status, "map.", field);
  return std::make_shared<MapActor>(map, map_options, next_epoch_++,
                                    MapActorOptionsOf(options_, news_), metrics_);
}

absl::Status Registry::CheckRoomLocked() const {
  if (maps_.size() < static_cast<std::size_t>(options_.maps_max)) return absl::OkStatus();
  return absl::ResourceExhaustedError(
      absl::StrCat("there are ", maps_.size(), " maps, want at most ", options_.maps_max));
}

std::shared_ptr<LocalMapFeed> Registry::FeedOfLocked(const std::string& robot) {
  // Of robots that are forgotten and not watched; not with every session.
  if (feeds_.size() > 2 * robots_.size() + 64)
    absl::erase_if(feeds_, [](const auto& entry) { return entry.second.expired(); });
  std::weak_ptr<LocalMapFeed>& known = feeds_[robot];
  std::shared_ptr<LocalMapFeed> feed = known.lock();
  if (feed == nullptr) known = feed = std::make_shared<LocalMapFeed>(news_);
  return feed;
}

absl::StatusOr<std::shared_ptr<MapActor>> Registry::CreateMap(const std::string& map,
                                                              const wire::MapSetup& setup,
                                                              const std::string& request_id) {
  MutexLock lock(mutex_);
  absl::StatusOr<std::shared_ptr<MapActor>> earlier = CheckNewMapLocked(map, request_id);
  if (!earlier.ok() || *earlier != nullptr) return earlier;
  auto made = MakeMapLocked(map, setup, "setup.");
  if (!made.ok()) return made.status();
  maps_[map] = *made;
  made_.Remember(map, request_id, (*made)->epoch());
  spdlog::info("map {} created", map);
  return made;
}

absl::StatusOr<std::shared_ptr<MapActor>> Registry::CheckNewMap(
    const std::string& map, const std::string& request_id) const {
  MutexLock lock(mutex_);
  absl::StatusOr<std::shared_ptr<MapActor>> earlier = CheckNewMapLocked(map, request_id);
  if (earlier.ok() && *earlier == nullptr) GEM_RETURN_IF_ERROR(CheckRoomLocked());
  return earlier;
}

std::uint64_t Registry::NewEpoch() {
  MutexLock lock(mutex_);
  return next_epoch_++;
}

absl::StatusOr<std::shared_ptr<MapActor>> Registry::EnterMap(const std::string& map,
                                                             std::unique_ptr<GlobalMapper> mapper,
                                                             const std::string& request_id) {
  MutexLock lock(mutex_);
  absl::StatusOr<std::shared_ptr<MapActor>> earlier = CheckNewMapLocked(map, request_id);
  if (!earlier.ok() || *earlier != nullptr) return earlier;
  GEM_RETURN_IF_ERROR(CheckRoomLocked());
  auto made = std::make_shared<MapActor>(map, std::move(mapper), MapActorOptionsOf(options_, news_),
                                         metrics_);
  maps_[map] = made;
  made_.Remember(map, request_id, made->epoch());
  spdlog::info("map {} imported", map);
  return made;
}

absl::StatusOr<std::shared_ptr<MapActor>> Registry::CheckNewMapLocked(
    const std::string& map, const std::string& request_id) const {
  if (stopped_) return GoingAway();
  const auto found = maps_.find(map);
  if (const std::uint64_t* epoch = made_.Find(map, request_id)) {
    if (found != maps_.end() && found->second->epoch() == *epoch) return found->second;
    return wire::WithField(absl::FailedPreconditionError(
                               absl::StrCat("request_id is ", request_id, ", which made a map ",
                                            map, " that has been deleted, want a new id")),
                           "request_id");
  }
  if (found != maps_.end())
    return wire::WithField(
        absl::AlreadyExistsError(absl::StrCat("map is ", map, ", which exists, want a new id")),
        "map");
  return nullptr;
}

absl::Status Registry::DeleteMap(const std::string& id, const std::string& request_id, bool force) {
  std::shared_ptr<MapActor> map;
  std::vector<std::shared_ptr<SessionActor>> sessions;
  {
    MutexLock lock(mutex_);
    if (stopped_) return GoingAway();
    if (deleted_.Find(id, request_id) != nullptr) return absl::OkStatus();
    absl::StatusOr<std::shared_ptr<MapActor>> found = FindMapLocked(id);
    if (!found.ok()) return found.status();
    map = *std::move(found);
    if (!force) GEM_RETURN_IF_ERROR(CheckUnfedLocked(id));
    sessions = TakeOutLocked(id);
    deleted_.Remember(id, request_id, map->epoch());
  }
  // From here on nobody finds them: a session that is opened now feeds a new map.
  spdlog::info("map {} deleted, with {} sessions", id, sessions.size());
  map->Delete();
  for (const auto& session : sessions) session->Abandon(map->status());
  for (const auto& session : sessions) session->Join();
  map->Join();
  return absl::OkStatus();
}

absl::Status Registry::CheckUnfedLocked(const std::string& map) const {
  std::vector<absl::string_view> names;
  std::size_t num_more = 0;
  for (const auto& session : by_age_) {
    if (session->map()->id() != map || !session->feeds_map()) continue;
    if (names.size() < kSessionsNamed_max) {
      names.push_back(session->config().setup.session);
    } else {
      ++num_more;
    }
  }
  if (names.empty()) return absl::OkStatus();
  const std::string more = num_more == 0 ? "" : absl::StrCat(" and ", num_more, " more");
  return wire::WithField(absl::FailedPreconditionError(absl::StrCat(
                             "map is ", map, ", which is fed by the sessions ",
                             absl::StrJoin(names, ", "), more, ", want none, or force")),
                         "map");
}

std::vector<std::shared_ptr<SessionActor>> Registry::TakeOutLocked(const std::string& map) {
  std::vector<std::shared_ptr<SessionActor>> sessions;
  for (const auto& session : by_age_)
    if (session->map()->id() == map) sessions.push_back(session);
  for (const auto& session : sessions) {
    const std::string& id = session->config().setup.session;
    if (session->feeds_map()) cut_off_.Remember(map, id, session->map()->epoch());
    ForgetLocked(*session);
  }
  std::erase_if(by_age_, [&](const auto& session) { return session->map()->id() == map; });
  maps_.erase(map);
  return sessions;
}

void Registry::ForgetLocked(const SessionActor& session) {
  const wire::SessionSetup& setup = session.config().setup;
  sessions_.erase(SessionKey(setup.map, setup.session));
  const auto robot = robots_.find(setup.robot);
  if (robot != robots_.end() && robot->second.get() == &session) robots_.erase(robot);
}

std::vector<std::shared_ptr<SessionActor>> Registry::ForgetEndedLocked() {
  std::vector<std::shared_ptr<SessionActor>> forgotten;
  auto num_ended = std::count_if(by_age_.begin(), by_age_.end(),
                                 [](const auto& session) { return !session->active(); });
  for (auto it = by_age_.begin(); it != by_age_.end() && num_ended > options_.ended_sessions_max;) {
    if ((*it)->active()) {
      ++it;
      continue;
    }
    ForgetLocked(**it);
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
  return FindMapLocked(map);
}

absl::StatusOr<std::shared_ptr<MapActor>> Registry::FindMapLocked(const std::string& map) const {
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

absl::StatusOr<std::shared_ptr<const LocalMapFeed>> Registry::FindLocalMaps(
    const std::string& robot) const {
  const absl::StatusOr<std::shared_ptr<SessionActor>> session = FindRobot(robot);
  if (!session.ok()) return session.status();
  return (*session)->feed();
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
