// The messages of WatchLocalMap: the newest map whenever the reader can take one.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>

#include "proto/wire/map.h"
#include "proto/wire/tile_request.h"
#include "server/encoded_cache.h"
#include "server/local_map_feed.h"
#include "server/message_source.h"
#include "server/metrics.h"

namespace gem {

/// T_G_O of the session as its published map has it; of its opening before it is published.
wire::LocalMapContext ContextOf(const LocalMapOrigin& origin);

class LocalMapSource final : public MessageSource {
 public:
  /// cache and metrics outlive the source.
  LocalMapSource(std::shared_ptr<const LocalMapFeed> feed, wire::CellSelection cells,
                 double min_interval_s, EncodedCache& cache, Metrics& metrics);

  Next TakeNext(Clock::time_point now) override;
  std::optional<Clock::time_point> behind_since() const override;

 private:
  // Constant after construction.
  const std::shared_ptr<const LocalMapFeed> feed_;
  const wire::CellSelection cells_;
  const std::chrono::nanoseconds min_interval_;
  EncodedCache& cache_;
  Metrics& metrics_;

  /// Number of the map that was told last; 0: none was.
  std::atomic<std::uint64_t> told_{0};
  std::atomic<Clock::rep> next_ticks_{0};  ///< when the next one may be told
};

}  // namespace gem
