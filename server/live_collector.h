// The metrics that are computed when they are asked for: queues, sessions, what maps hold and how
// far they and their readers are behind. Those of a map that is deleted vanish with it.
#pragma once

#include <prometheus/collectable.h>
#include <prometheus/metric_family.h>

#include <vector>

#include "server/encoded_cache.h"
#include "server/registry.h"
#include "server/turn_scheduler.h"

namespace gem {

class LiveCollector final : public prometheus::Collectable {
 public:
  /// All outlive the collector.
  LiveCollector(const Registry& registry, const TurnScheduler& readers, const EncodedCache& cache)
      : registry_(registry), readers_(readers), cache_(cache) {}

  /// gem_queue_bytes, gem_queue_oldest_seconds, gem_sessions{state}; of each map gem_submaps,
  /// gem_points, gem_submap_bytes, gem_tiles, gem_map_staleness_seconds,
  /// gem_map_revision_age_seconds, gem_correction_oldest_seconds, gem_waiting_corrections,
  /// gem_replaced_revisions, gem_replaced_revision_bytes, gem_expired_reads_total;
  /// gem_watch_lag_seconds; gem_tile_cache_bytes, gem_tile_cache_requests_total{result},
  /// gem_tile_cache_evictions_total.
  std::vector<prometheus::MetricFamily> Collect() const override;

 private:
  const Registry& registry_;
  const TurnScheduler& readers_;
  const EncodedCache& cache_;
};

}  // namespace gem
