#include "server/server_status.h"

#include <algorithm>
#include <chrono>
#include <optional>

#include "core/base/process_stat.h"
#include "gem/v1/map_service.pb.h"

namespace gem {
namespace {

constexpr std::size_t kSessionsOfStatus_max = 1000;

double Age_s(Clock::time_point now, std::optional<Clock::time_point> since) {
  return since.has_value() ? std::chrono::duration<double>(now - *since).count() : 0;
}

void SessionToProto(const SessionActor& session, Clock::time_point now, v1::SessionStatus* proto) {
  const SessionMailbox::Load load = session.mailbox().load();
  const wire::SessionSetup& setup = session.config().setup;
  proto->set_map(setup.map);
  proto->set_robot(setup.robot);
  proto->set_session(setup.session);
  proto->set_active(session.active());
  proto->set_connected(load.connected);
  proto->set_num_scans_fused(session.num_scans_fused());
  proto->set_num_scans_refused(session.num_scans_refused());
  proto->set_queue_bytes(load.queue_bytes);
  proto->set_fused_seq(load.fused_seq);
  proto->set_oldest_s(Age_s(now, load.oldest));
  proto->set_num_scans_dropped(session.num_scans_dropped());
}

template <typename Proto>
void BucketsToProto(const std::vector<TimingBucket>& buckets, Proto* proto) {
  for (const TimingBucket& bucket : buckets) {
    v1::TimingBucket* to = proto->add_buckets();
    to->set_upper_s(bucket.upper_s);
    to->set_count(bucket.count);
  }
}

void TimingToProto(const StageTotals& timing, v1::StageTiming* proto) {
  proto->set_mapper(timing.mapper);
  proto->set_stage(timing.stage);
  proto->set_count(timing.count);
  proto->set_total_s(timing.total_s);
  proto->set_max_s(timing.max_s);
  BucketsToProto(timing.buckets, proto);
}

void CallsToProto(const MethodTotals& calls, v1::CallStatus* proto) {
  proto->set_method(calls.method);
  proto->set_num_started(calls.num_started);
  proto->set_num_failed(calls.num_failed);
  proto->set_num_active(static_cast<std::uint32_t>(std::max(calls.num_active, 0)));
  proto->set_received_bytes(calls.received_bytes);
  proto->set_sent_bytes(calls.sent_bytes);
  proto->set_total_s(calls.total_s);
  BucketsToProto(calls.buckets, proto);
}

void LagToProto(const MapActor& map, Clock::time_point now, v1::MapLag* proto) {
  const MapActor::Lag lag = map.lag();
  proto->set_map(map.id());
  proto->set_staleness_s(Age_s(now, lag.oldest_waiting));
  proto->set_version_age_s(Age_s(now, lag.published));
  proto->set_num_corrections_waiting(static_cast<std::uint32_t>(lag.num_corrections));
}

void ProcessToProto(v1::ProcessStatus* proto) {
  if (const std::optional<ProcessStat> stat = ReadProcessStat()) {
    proto->set_resident_bytes(stat->resident_bytes);
    proto->set_cpu_s(stat->cpu_s);
    proto->set_num_threads(static_cast<std::uint32_t>(stat->num_threads));
  }
  proto->set_num_open_files(static_cast<std::uint32_t>(CountOpenFiles().value_or(0)));
}

}  // namespace

void StatusToProto(const Registry& registry, const Metrics& metrics,
                   v1::GetServerStatusResponse* response) {
  const auto sessions = registry.Sessions();
  const Clock::time_point now = Clock::now();
  for (std::size_t i = 0; i < std::min(sessions.size(), kSessionsOfStatus_max); ++i)
    SessionToProto(*sessions[i], now, response->add_sessions());
  for (const StageTotals& timing : metrics.Timings())
    TimingToProto(timing, response->add_timings());
  for (const MethodTotals& calls : metrics.Calls()) CallsToProto(calls, response->add_calls());
  for (const auto& map : registry.Maps()) LagToProto(*map, now, response->add_lags());
  ProcessToProto(response->mutable_process());
  const TileTotals tiles = metrics.Tiles();
  response->mutable_tiles()->set_num_full(tiles.num_full);
  response->mutable_tiles()->set_num_absent(tiles.num_absent);
}

}  // namespace gem
