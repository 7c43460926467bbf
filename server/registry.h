// All maps, sessions and robots of the server, and how many there may be. Thread-safe.
#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/container/btree_map.h"
#include "absl/container/flat_hash_map.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "core/base/mutex.h"
#include "proto/wire/session_setup.h"
#include "server/answer_memory.h"
#include "server/ingest_budget.h"
#include "server/local_map_feed.h"
#include "server/map_actor.h"
#include "server/metrics.h"
#include "server/options.h"
#include "server/session_actor.h"

namespace gem {

class Registry {
 public:
  /// options are valid. epoch: of the first map that is made; each one after it has the next, so
  /// that a map that is made again under an id is not taken for the one before. news: hears of new
  /// revisions and local maps, outlives the registry; may be null.
  Registry(const ServerOptions& options, std::uint64_t epoch, Metrics& metrics,
           NewsListener* news = nullptr);
  ~Registry();

  /// The session, new or one to be resumed; the map is created if there is none. An error names the
  /// field of open: INVALID_ARGUMENT, FAILED_PRECONDITION (the map or the session is not as the
  /// setup says, or has ended), RESOURCE_EXHAUSTED. A resumed session keeps its first setup.
  absl::StatusOr<std::shared_ptr<SessionActor>> OpenSession(const wire::SessionSetup& setup);

  /// Makes an empty map. ALREADY_EXISTS if there is one with the id, unless the same request made
  /// it; FAILED_PRECONDITION if the map that the request made has been deleted meanwhile.
  /// INVALID_ARGUMENT names the field of setup; RESOURCE_EXHAUSTED.
  absl::StatusOr<std::shared_ptr<MapActor>> CreateMap(const std::string& map,
                                                      const wire::MapSetup& setup,
                                                      const std::string& request_id);
  /// For maps that take time to make. The map that the request made before, or null: EnterMap()
  /// would take it now. Errors as of CreateMap().
  absl::StatusOr<std::shared_ptr<MapActor>> CheckNewMap(const std::string& map,
                                                        const std::string& request_id) const;
  /// For a map that is to be entered.
  std::uint64_t NewEpoch();
  /// Enters a map that was made elsewhere. Errors as of CreateMap(), and the map that the same
  /// request has made meanwhile.
  absl::StatusOr<std::shared_ptr<MapActor>> EnterMap(const std::string& map,
                                                     std::unique_ptr<GlobalMapper> mapper,
                                                     const std::string& request_id);
  /// Forgets a map and its sessions; streams, and all who wait for it, are told NOT_FOUND. It may
  /// be made again at once. NOT_FOUND; FAILED_PRECONDITION names the sessions that feed it, unless
  /// force is set. Blocks until the map's threads have ended and its memory is free: not for gRPC's
  /// threads.
  absl::Status DeleteMap(const std::string& map, const std::string& request_id, bool force);

  /// The session if it is known, ended or not, and the robot's own; else null.
  std::shared_ptr<SessionActor> FindSession(const wire::SessionSetup& setup) const;

  /// NOT_FOUND names the field "map".
  absl::StatusOr<std::shared_ptr<MapActor>> FindMap(const std::string& map) const;
  /// The robot's newest session. NOT_FOUND names the field "robot".
  absl::StatusOr<std::shared_ptr<SessionActor>> FindRobot(const std::string& robot) const;
  /// The local maps of a robot that had a session. NOT_FOUND names the field "robot".
  absl::StatusOr<std::shared_ptr<const LocalMapFeed>> FindLocalMaps(const std::string& robot) const;
  /// By id.
  std::vector<std::shared_ptr<MapActor>> Maps() const;
  /// Newest first, ended ones included while they are kept.
  std::vector<std::shared_ptr<SessionActor>> Sessions() const;

  /// Stops all threads without ending sessions. Nothing can be opened any more.
  void Stop();

 private:
  using SessionKey = std::pair<std::string, std::string>;  ///< map, session

  absl::StatusOr<std::shared_ptr<MapActor>> FindMapLocked(const std::string& map) const
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::StatusOr<std::shared_ptr<MapActor>> CheckNewMapLocked(const std::string& map,
                                                              const std::string& request_id) const
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status CheckRoomLocked() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::StatusOr<std::shared_ptr<MapActor>> FindOrMakeMapLocked(const wire::SessionSetup& setup)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  /// Does not enter it into the books. field: of the request, for errors.
  absl::StatusOr<std::shared_ptr<MapActor>> MakeMapLocked(const std::string& map,
                                                          const wire::MapSetup& setup,
                                                          const std::string& field)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::StatusOr<std::shared_ptr<SessionActor>> AddSessionLocked(const wire::SessionSetup& setup)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  std::shared_ptr<LocalMapFeed> FeedOfLocked(const std::string& robot)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  /// Takes the ended sessions that are too many out of the books.
  std::vector<std::shared_ptr<SessionActor>> ForgetEndedLocked()
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void ForgetLocked(const SessionActor& session) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  /// FAILED_PRECONDITION names the sessions that feed the map.
  absl::Status CheckUnfedLocked(const std::string& map) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  /// Takes a map and its sessions, which are returned, out of the books.
  std::vector<std::shared_ptr<SessionActor>> TakeOutLocked(const std::string& map)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  // Constant after construction.
  const ServerOptions options_;
  Metrics& metrics_;
  NewsListener* const news_;

  IngestBudget ingest_budget_;  ///< of all sessions
  mutable Mutex mutex_;
  absl::btree_map<std::string, std::shared_ptr<MapActor>> maps_ ABSL_GUARDED_BY(mutex_);
  absl::flat_hash_map<SessionKey, std::shared_ptr<SessionActor>> sessions_ ABSL_GUARDED_BY(mutex_);
  std::deque<std::shared_ptr<SessionActor>> by_age_ ABSL_GUARDED_BY(mutex_);  ///< oldest first
  absl::flat_hash_map<std::string, std::shared_ptr<SessionActor>> robots_ ABSL_GUARDED_BY(mutex_);
  /// By robot; held by sessions, and by those who watch and wait for the next one.
  absl::flat_hash_map<std::string, std::weak_ptr<LocalMapFeed>> feeds_ ABSL_GUARDED_BY(mutex_);
  std::uint64_t next_epoch_ ABSL_GUARDED_BY(mutex_);
  AnswerMemory<std::uint64_t> made_ ABSL_GUARDED_BY(mutex_);     ///< epochs of maps, by request
  AnswerMemory<std::uint64_t> deleted_ ABSL_GUARDED_BY(mutex_);  ///< the same
  /// By map and session: sessions that were active when their map was deleted. Their robots come
  /// back with the rest of a trajectory whose beginning is gone.
  AnswerMemory<std::uint64_t> cut_off_ ABSL_GUARDED_BY(mutex_);
  bool stopped_ ABSL_GUARDED_BY(mutex_) = false;
};

}  // namespace gem
