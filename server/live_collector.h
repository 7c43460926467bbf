// The metrics that are computed when they are asked for: queues and sessions.
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

  /// gem_queue_bytes, gem_queue_oldest_seconds, gem_sessions{state}.
  std::vector<prometheus::MetricFamily> Collect() const override;

 private:
  const Registry& registry_;
};

}  // namespace gem
