#include "client/cli/top_rates.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>

namespace gem::client {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

/// The element of `items` that `is_it` accepts; a default one if there is none: what is new began
/// with nothing.
template <typename T, typename Predicate>
T FindOr(const std::vector<T>& items, Predicate is_it) {
  const auto found = std::find_if(items.begin(), items.end(), is_it);
  return found == items.end() ? T{} : *found;
}

/// Counters only grow; what shrank belongs to something new of the same name.
double Grown(std::uint64_t before, std::uint64_t now) {
  return static_cast<double>(now >= before ? now - before : now);
}

/// Runs of the interval by duration.
class Durations {
 public:
  Durations(const std::vector<TimingBucket>& before, const std::vector<TimingBucket>& now)
      : buckets_(now) {
    if (before.size() != now.size()) return;
    for (std::size_t i = 0; i < now.size(); ++i)
      buckets_[i].count -= std::min(before[i].count, now[i].count);
  }

  /// Interpolated between the edges of a bucket; never beyond the last finite edge.
  double Quantile(double q) const {
    if (empty()) return kNaN;
    const double rank = q * static_cast<double>(buckets_.back().count);
    double lower_s = 0, below = 0;
    for (const TimingBucket& bucket : buckets_) {
      const auto count = static_cast<double>(bucket.count);
      if (count >= rank && count > below) {
        if (!std::isfinite(bucket.upper_s)) return lower_s;
        return lower_s + (bucket.upper_s - lower_s) * (rank - below) / (count - below);
      }
      below = count;
      lower_s = bucket.upper_s;
    }
    return lower_s;
  }

  /// Edge of the highest bucket in which something is.
  double UpperBound() const {
    if (empty()) return kNaN;
    for (const TimingBucket& bucket : buckets_)
      if (bucket.count == buckets_.back().count) return bucket.upper_s;
    return kNaN;
  }

 private:
  bool empty() const { return buckets_.empty() || buckets_.back().count == 0; }

  std::vector<TimingBucket> buckets_;
};

template <typename Timing>
TimesMs TimesOf(const Durations& durations, const Timing& before, const Timing& now, double runs) {
  const double total_s = now.total_s >= before.total_s ? now.total_s - before.total_s : now.total_s;
  return {runs > 0 ? total_s / runs * 1e3 : kNaN, durations.Quantile(0.5) * 1e3,
          durations.Quantile(0.99) * 1e3, kNaN};
}

StageRates StageOf(const StageTiming& before, const StageTiming& now, double interval_s) {
  const Durations durations(before.buckets, now.buckets);
  const double runs = Grown(before.count, now.count);
  StageRates rates{now.mapper, now.stage, runs / interval_s, TimesOf(durations, before, now, runs)};
  // A longest run that is new happened now.
  const double max_s =
      now.max_s > before.max_s ? now.max_s : std::min(now.max_s, durations.UpperBound());
  rates.times.max = runs > 0 ? max_s * 1e3 : kNaN;
  rates.times.p50 = std::min(rates.times.p50, now.max_s * 1e3);
  rates.times.p99 = std::min(rates.times.p99, now.max_s * 1e3);
  return rates;
}

CallRates CallOf(const CallStatus& before, const CallStatus& now, double interval_s) {
  const std::uint64_t ended_before = before.buckets.empty() ? 0 : before.buckets.back().count;
  const std::uint64_t ended_now = now.buckets.empty() ? 0 : now.buckets.back().count;
  return {
      now.method,
      Grown(before.num_started, now.num_started) / interval_s,
      Grown(before.num_failed, now.num_failed) / interval_s,
      now.num_active,
      Grown(before.received_bytes, now.received_bytes) / interval_s,
      Grown(before.sent_bytes, now.sent_bytes) / interval_s,
      TimesOf(Durations(before.buckets, now.buckets), before, now, Grown(ended_before, ended_now))};
}

RobotRates RobotOf(const SessionStatus& before, const SessionStatus& now, double interval_s) {
  return {now.map,
          now.robot,
          now.session,
          now.connected,
          Grown(before.num_scans_fused, now.num_scans_fused) / interval_s,
          Grown(before.num_scans_refused, now.num_scans_refused) / interval_s,
          now.queue_bytes,
          now.oldest_s};
}

MapRates MapOf(const MapInfo& before, const MapInfo& now, const MapLag& lag, double interval_s) {
  // A map of another epoch has nothing to do with the one before.
  const MapInfo& base = before.version.epoch == now.version.epoch ? before : MapInfo{};
  return {now.id,
          now.num_submaps,
          now.num_points,
          now.num_tiles,
          now.submap_bytes,
          now.version.revision,
          Grown(base.version.revision, now.version.revision) / interval_s,
          (static_cast<double>(now.num_points) - static_cast<double>(base.num_points)) / interval_s,
          lag.staleness_s,
          lag.num_corrections_waiting};
}

void AddRobots(const ServerStatus& before, const ServerStatus& now, TopRates& rates) {
  for (const SessionStatus& session : now.sessions) {
    if (!session.active) {
      ++rates.num_ended_sessions;
      continue;
    }
    const SessionStatus base = FindOr(before.sessions, [&](const SessionStatus& s) {
      return s.map == session.map && s.session == session.session;
    });
    rates.robots.push_back(RobotOf(base, session, rates.interval_s));
  }
  std::sort(rates.robots.begin(), rates.robots.end(), [](const auto& a, const auto& b) {
    return std::tie(a.map, a.robot, a.session) < std::tie(b.map, b.robot, b.session);
  });
}

void AddMaps(const TopSample& before, const TopSample& now, TopRates& rates) {
  for (const MapInfo& map : now.maps) {
    const MapInfo base = FindOr(before.maps, [&](const MapInfo& m) { return m.id == map.id; });
    const MapLag lag = FindOr(now.status.lags, [&](const MapLag& l) { return l.map == map.id; });
    rates.maps.push_back(MapOf(base, map, lag, rates.interval_s));
  }
}

}  // namespace

TopRates RatesBetween(const TopSample& before, const TopSample& now) {
  const bool restarted = now.status.uptime_s < before.status.uptime_s;
  const TopSample base = restarted ? TopSample{} : before;
  const ServerStatus& status = now.status;
  TopRates rates;
  rates.server_version = status.server_version;
  rates.backend = status.backend;
  rates.uptime_s = status.uptime_s;
  // Two looks at the same moment show nothing new; the smallest interval keeps that at 0.
  rates.interval_s = std::max(status.uptime_s - base.status.uptime_s, 1e-3);
  rates.process = status.process;
  rates.cpu_cores =
      std::max(0.0, status.process.cpu_s - base.status.process.cpu_s) / rates.interval_s;
  rates.tiles_hz = Grown(base.status.tiles.num_full, status.tiles.num_full) / rates.interval_s;
  rates.absent_tiles_hz =
      Grown(base.status.tiles.num_absent, status.tiles.num_absent) / rates.interval_s;
  AddRobots(base.status, status, rates);
  AddMaps(base, now, rates);
  for (const StageTiming& timing : status.timings) {
    if (timing.count == 0) continue;
    const StageTiming earlier = FindOr(base.status.timings, [&](const StageTiming& t) {
      return t.mapper == timing.mapper && t.stage == timing.stage;
    });
    rates.stages.push_back(StageOf(earlier, timing, rates.interval_s));
  }
  for (const CallStatus& call : status.calls) {
    if (call.num_started == 0) continue;
    const CallStatus earlier =
        FindOr(base.status.calls, [&](const CallStatus& c) { return c.method == call.method; });
    rates.calls.push_back(CallOf(earlier, call, rates.interval_s));
  }
  return rates;
}

}  // namespace gem::client
