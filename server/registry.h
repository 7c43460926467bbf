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
#include "server/map_actor.h"
#include "server/metrics.h"
#include "server/options.h"
#include "server/session_actor.h"

namespace gem {

class Registry {
 public:
  /// options are valid. epoch: of the versions of all maps.
  Registry(const ServerOptions& options, std::uint64_t epoch, Metrics& metrics);
  ~Registry();

  /// The session, new or one to be resumed; the map is created if there is none. An error names the
  /// field of open: INVALID_ARGUMENT, FAILED_PRECONDITION (the map or the session is not as the
  /// setup says, or has ended), RESOURCE_EXHAUSTED. A resumed session keeps its first setup.
  absl::StatusOr<std::shared_ptr<SessionActor>> OpenSession(const wire::SessionSetup& setup);

  /// The session if it is known, ended or not, and the robot's own; else null.
  std::shared_ptr<SessionActor> FindSession(const wire::SessionSetup& setup) const;

  /// NOT_FOUND names the field "map".
  absl::StatusOr<std::shared_ptr<MapActor>> FindMap(const std::string& map) const;
  /// The robot's newest session. NOT_FOUND names the field "robot".
  absl::StatusOr<std::shared_ptr<SessionActor>> FindRobot(const std::string& robot) const;
  /// By id.
  std::vector<std::shared_ptr<MapActor>> Maps() const;
  /// Newest first, ended ones included while they are kept.
  std::vector<std::shared_ptr<SessionActor>> Sessions() const;

  /// Stops all threads without ending sessions. Nothing can be opened any more.
  void Stop();

 private:
  using SessionKey = std::pair<std::string, std::string>;  ///< map, session

  absl::StatusOr<std::shared_ptr<MapActor>> FindOrAddMapLocked(const wire::SessionSetup& setup)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::StatusOr<std::shared_ptr<SessionActor>> AddSessionLocked(const wire::SessionSetup& setup)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  /// Takes the ended sessions that are too many out of the books.
  std::vector<std::shared_ptr<SessionActor>> ForgetLocked() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  // Constant after construction.
  const ServerOptions options_;
  const std::uint64_t epoch_;
  Metrics& metrics_;

  mutable Mutex mutex_;
  absl::btree_map<std::string, std::shared_ptr<MapActor>> maps_ ABSL_GUARDED_BY(mutex_);
  absl::flat_hash_map<SessionKey, std::shared_ptr<SessionActor>> sessions_ ABSL_GUARDED_BY(mutex_);
  std::deque<std::shared_ptr<SessionActor>> by_age_ ABSL_GUARDED_BY(mutex_);  ///< oldest first
  absl::flat_hash_map<std::string, std::shared_ptr<SessionActor>> robots_ ABSL_GUARDED_BY(mutex_);
  bool stopped_ ABSL_GUARDED_BY(mutex_) = false;
};

}  // namespace gem
