// The newest robocentric map of a robot as it comes; what a slow reader cannot take is skipped.
// Goes on with the robot's next session, and after a disconnect.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "client/connection.h"
#include "client/map_client.h"
#include "client/map_types.h"
#include "client/retry_thread.h"
#include "client/watch_state.h"

namespace gem::client {

struct SubscriberOptions {
  std::string robot;
  CellSelection cells = {{Layer::kElevation, Layer::kTraversability}, CellEncoding::kCompact};
  /// At most this often, seconds between two maps. Range [0, 3600].
  double min_interval_s = 0;
  /// Between tries to reach the server.
  RetryOptions retry;
  /// Called for every map, from the subscriber's thread, which waits for it. Must not destroy the
  /// subscriber.
  std::function<void(const std::shared_ptr<const LocalMap>& map)> on_map;
};

struct SubscriberStats : WatchStats {
  std::uint64_t num_maps = 0;     ///< that came
  std::uint64_t num_skipped = 0;  ///< published between those
};

/// Thread-safe.
class LocalMapSubscriber {
 public:
  /// Begins at once; a server or a robot that is not there yet is waited for.
  LocalMapSubscriber(std::shared_ptr<const Connection> connection, SubscriberOptions options);
  ~LocalMapSubscriber();
  LocalMapSubscriber(const LocalMapSubscriber&) = delete;
  LocalMapSubscriber& operator=(const LocalMapSubscriber&) = delete;

  /// The newest; null before the first. Takes no lock of the subscriber.
  std::shared_ptr<const LocalMap> map() const;

  /// Waits for a map other than `than`, which may be null. Errors as MapMirror::WaitForOther().
  absl::StatusOr<std::shared_ptr<const LocalMap>> WaitForOther(
      const std::shared_ptr<const LocalMap>& than, double timeout_s) const;

  SubscriberStats stats() const;

 private:
  class Impl;
  const std::unique_ptr<Impl> impl_;
};

}  // namespace gem::client
