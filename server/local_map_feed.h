// The newest local map of a robot, across its sessions, for those who ask and those who watch.
// Thread-safe; sessions never wait for readers.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "core/base/mutex.h"
#include "core/geometry/pose.h"
#include "core/local/local_map.h"
#include "server/ingest_message.h"
#include "server/news.h"

namespace gem {

class MapActor;

/// Whose local map it is.
struct LocalMapOrigin {
  std::string session;
  std::weak_ptr<const MapActor> map;  ///< knows the session's T_G_O while it lives
  Pose<Global, Odom> T_G_O;           ///< of the session's opening
};

class LocalMapFeed {
 public:
  /// listener outlives the feed; may be null.
  explicit LocalMapFeed(NewsListener* listener) : listener_(listener) {}

  NewsSource source() const { return source_; }

  /// A session of the robot begins: its maps replace those of older sessions from now on. Returns
  /// its ticket.
  std::uint64_t Begin(LocalMapOrigin origin);
  /// Ignored if a newer session has begun.
  void Publish(std::uint64_t ticket, std::shared_ptr<const LocalMap> map);

  struct Newest {
    std::shared_ptr<const LocalMap> map;  ///< null: the newest session has none yet
    std::shared_ptr<const LocalMapOrigin> origin;
    std::uint64_t number = 0;  ///< of all maps of the robot that were published, from 1
    Clock::time_point since;   ///< when it was
  };
  Newest newest() const;

 private:
  NewsListener* const listener_;
  const NewsSource source_ = NewNewsSource();

  mutable Mutex mutex_;
  std::uint64_t last_ticket_ ABSL_GUARDED_BY(mutex_) = 0;
  Newest newest_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace gem
