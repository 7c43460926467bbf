#include "server/local_map_source.h"

#include <algorithm>
#include <utility>

#include "proto/wire/local_map_message.h"
#include "server/map_actor.h"
#include "server/tile_encoder.h"

namespace gem {

wire::LocalMapContext ContextOf(const LocalMapOrigin& origin) {
  wire::LocalMapContext context{origin.T_G_O, origin.session};
  const std::shared_ptr<const MapActor> map = origin.map.lock();
  if (map == nullptr) return context;
  const std::shared_ptr<const MapSnapshot> snapshot = map->snapshot();
  for (const SessionInfo& info : snapshot->sessions)
    if (info.session == origin.session) context.T_G_O = info.T_G_O;
  return context;
}

LocalMapSource::LocalMapSource(std::shared_ptr<const LocalMapFeed> feed, wire::CellSelection cells,
                               double min_interval_s, EncodedCache& cache, Metrics& metrics)
    : feed_(std::move(feed)),
      cells_(std::move(cells)),
      min_interval_(static_cast<std::int64_t>(min_interval_s * 1e9)),
      cache_(cache),
      metrics_(metrics) {}

MessageSource::Next LocalMapSource::TakeNext(Clock::time_point now) {
  Next next;
  const LocalMapFeed::Newest newest = feed_->newest();
  const std::uint64_t told = told_.load(std::memory_order_relaxed);
  if (newest.map == nullptr || newest.number == told) return next;
  const Clock::time_point next_at(Clock::duration(next_ticks_.load(std::memory_order_relaxed)));
  if (now < next_at) {
    next.wake_at = next_at;
    return next;
  }
  // The first map skips nothing: nobody was there to miss the ones before.
  const std::uint64_t num_skipped = told == 0 ? 0 : newest.number - told - 1;
  next.message = wire::WatchLocalMapMessage(
      *newest.map, ContextOf(*newest.origin),
      EncodeGrid(cache_, feed_->source(), newest.number, *newest.map, cells_), num_skipped);
  metrics_.CountSkippedVersions(num_skipped);
  told_.store(newest.number, std::memory_order_relaxed);
  next_ticks_.store((now + min_interval_).time_since_epoch().count(), std::memory_order_relaxed);
  return next;
}

std::optional<Clock::time_point> LocalMapSource::behind_since() const {
  const LocalMapFeed::Newest newest = feed_->newest();
  const std::uint64_t told = told_.load(std::memory_order_relaxed);
  if (newest.map == nullptr || newest.number == told) return std::nullopt;
  // The first of several came some time after it could have been told.
  const Clock::time_point next_at(Clock::duration(next_ticks_.load(std::memory_order_relaxed)));
  return told == 0 || newest.number == told + 1 ? std::max(newest.since, next_at) : next_at;
}

}  // namespace gem
