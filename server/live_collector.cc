#include "server/live_collector.h"

#include <algorithm>
#include <optional>
#include <string>
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

prometheus::ClientMetric OfMap(const std::string& map, double value) {
  prometheus::ClientMetric metric = Value(value);
  metric.label.push_back({"map", map});
  return metric;
}

prometheus::ClientMetric Count(std::uint64_t value) {
  prometheus::ClientMetric metric;
  metric.counter.value = static_cast<double>(value);
  return metric;
}

prometheus::ClientMetric OfResult(const char* result, std::uint64_t value) {
  prometheus::ClientMetric metric = Count(value);
  metric.label.push_back({"result", result});
  return metric;
}

prometheus::MetricFamily Counter(const char* name, const char* help,
                                 std::vector<prometheus::ClientMetric> metrics) {
  return {name, help, prometheus::MetricType::Counter, std::move(metrics)};
}

prometheus::MetricFamily Gauge(const char* name, const char* help,
                               std::vector<prometheus::ClientMetric> metrics) {
  return {name, help, prometheus::MetricType::Gauge, std::move(metrics)};
}

double AgeAt(Clock::time_point now, std::optional<Clock::time_point> since) {
  return since.has_value() ? std::chrono::duration<double>(now - *since).count() : 0;
}

void AppendMaps(const Registry& registry, Clock::time_point now,
                std::vector<prometheus::MetricFamily>& families) {
  std::vector<prometheus::ClientMetric> submaps, points, submap_bytes, tiles;
  std::vector<prometheus::ClientMetric> staleness, revision_age, correction_age, corrections;
  for (const auto& map : registry.Maps()) {
    const std::shared_ptr<const MapSnapshot> snapshot = map->snapshot();
    submaps.push_back(OfMap(map->id(), static_cast<double>(snapshot->submaps.size())));
    points.push_back(OfMap(map->id(), static_cast<double>(snapshot->num_points)));
    submap_bytes.push_back(OfMap(map->id(), static_cast<double>(snapshot->submap_bytes)));
    tiles.push_back(OfMap(map->id(), static_cast<double>(snapshot->tiles.size())));
    const MapActor::Lag lag = map->lag();
    staleness.push_back(OfMap(map->id(), AgeAt(now, lag.oldest_waiting)));
    revision_age.push_back(OfMap(map->id(), AgeAt(now, lag.published)));
    correction_age.push_back(OfMap(map->id(), AgeAt(now, lag.oldest_correction)));
    corrections.push_back(OfMap(map->id(), lag.num_corrections));
  }
  families.push_back(
      Gauge("gem_submaps", "Submaps of a map, finished and growing", std::move(submaps)));
  families.push_back(Gauge("gem_points", "Cells in the submaps of a map", std::move(points)));
  families.push_back(
      Gauge("gem_submap_bytes", "Memory of a map's submaps", std::move(submap_bytes)));
  families.push_back(Gauge("gem_tiles", "Tiles of a map that hold cells", std::move(tiles)));
  families.push_back(
      Gauge("gem_map_staleness_seconds",
            "Age of the oldest news that no published revision shows; 0: the map is up to date",
            std::move(staleness)));
  families.push_back(Gauge("gem_map_revision_age_seconds",
                           "Time since the newest revision was published; grows without robots",
                           std::move(revision_age)));
  families.push_back(Gauge("gem_correction_oldest_seconds",
                           "Age of the oldest correction without an answer; 0: there is none",
                           std::move(correction_age)));
  families.push_back(
      Gauge("gem_waiting_corrections", "Corrections without an answer", std::move(corrections)));
}

void AppendHistories(const Registry& registry, std::vector<prometheus::MetricFamily>& families) {
  std::vector<prometheus::ClientMetric> revisions, bytes, expired_reads;
  for (const auto& map : registry.Maps()) {
    const MapHistory& history = *map->history();
    revisions.push_back(OfMap(map->id(), history.num_replaced()));
    bytes.push_back(OfMap(map->id(), static_cast<double>(history.bytes())));
    expired_reads.push_back(Count(history.num_expired_reads()));
    expired_reads.back().label.push_back({"map", map->id()});
  }
  families.push_back(Gauge("gem_replaced_revisions",
                           "Revisions that are kept for readers after a newer one was published",
                           std::move(revisions)));
  families.push_back(Gauge("gem_replaced_revision_bytes", "Memory that only such revisions hold",
                           std::move(bytes)));
  families.push_back(Counter("gem_expired_reads_total",
                             "Reads of a version that was not kept any more",
                             std::move(expired_reads)));
}

void AppendReaders(const TurnScheduler& readers, const EncodedCache& cache, Clock::time_point now,
                   std::vector<prometheus::MetricFamily>& families) {
  double lag_s = 0;
  for (const auto& reader : readers.takers())
    lag_s = std::max(lag_s, AgeAt(now, reader->behind_since()));
  families.push_back(
      Gauge("gem_watch_lag_seconds",
            "Age of the oldest published change that some stream has not told its reader",
            {Value(lag_s)}));
  const EncodedCache::Stats stats = cache.stats();
  families.push_back(Gauge("gem_tile_cache_bytes", "Encoded tiles and local maps that are kept",
                           {Value(static_cast<double>(stats.bytes))}));
  families.push_back(
      Counter("gem_tile_cache_requests_total", "Encoded tiles and local maps that were asked for",
              {OfResult("hit", stats.num_hits), OfResult("miss", stats.num_misses)}));
  families.push_back(Counter("gem_tile_cache_evictions_total",
                             "Encoded tiles and local maps that made room for others",
                             {Count(stats.num_evicted)}));
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
  AppendMaps(registry_, now, families);
  AppendHistories(registry_, families);
  AppendReaders(readers_, cache_, now, families);
  return families;
}

}  // namespace gem
