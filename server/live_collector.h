// The metrics that are computed when they are asked for: queues, sessions, what maps hold and how
// far they are behind. Those of a map that is deleted vanish with it.
#pragma once

#include <prometheus/collectable.h>
#include <prometheus/metric_family.h>

#include <vector>

#include "server/registry.h"

namespace gem {

class LiveCollector final : public prometheus::Collectable {
 public:
  /// The registry outlives the collector.
  explicit LiveCollector(const Registry& registry) : registry_(registry) {}

  /// gem_queue_bytes, gem_queue_oldest_seconds, gem_sessions{state}; of each map gem_submaps,
  /// gem_points, gem_submap_bytes, gem_tiles, gem_map_staleness_seconds,
  /// gem_map_revision_age_seconds, gem_correction_oldest_seconds, gem_waiting_corrections.
  std::vector<prometheus::MetricFamily> Collect() const override;

 private:
  const Registry& registry_;
};

}  // namespace gem
