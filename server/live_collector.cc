#include "server/live_collector.h"

#include <algorithm>
#include <utility>

namespace gem {
namespace {

prometheus::ClientMetric Value(double value) {
  prometheus::ClientMetric metric;
  metric.gauge.value = value;
  return metric;
}

prometheus::ClientMetric InState(const char* state, double value) {
  prometheus::ClientMetric metric = Value(value);
  metric.label.push_back({"state", state});
  return metric;
}

prometheus::MetricFamily Gauge(const char* name, const char* help,
                               std::vector<prometheus::ClientMetric> metrics) {
  return {name, help, prometheus::MetricType::Gauge, std::move(metrics)};
}

}  // namespace

std::vector<prometheus::MetricFamily> LiveCollector::Collect() const {
  const Clock::time_point now = Clock::now();
  double queue_bytes = 0, oldest_s = 0;
  int num_connected = 0, num_alone = 0;
  for (const auto& session : registry_.Sessions()) {
    const SessionMailbox::Load load = session->mailbox().load();
    if (session->active()) ++(load.connected ? num_connected : num_alone);
    queue_bytes += static_cast<double>(load.queue_bytes);
    if (load.oldest.has_value())
      oldest_s = std::max(oldest_s, std::chrono::duration<double>(now - *load.oldest).count());
  }
  std::vector<prometheus::MetricFamily> families;
  families.push_back(
      Gauge("gem_queue_bytes", "Bytes that wait for sessions", {Value(queue_bytes)}));
  families.push_back(Gauge("gem_queue_oldest_seconds",
                           "Age of the oldest scan that waits or is in hand", {Value(oldest_s)}));
  families.push_back(Gauge("gem_sessions",
                           "Sessions that have not ended, with and without a stream",
                           {InState("connected", num_connected), InState("alone", num_alone)}));
  return families;
}

}  // namespace gem
