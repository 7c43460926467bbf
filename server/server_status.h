// The server at a glance, as MapService.GetServerStatus tells it: sessions, timings, calls, lags,
// the process. What an operator wants without Prometheus.
#pragma once

#include "server/metrics.h"
#include "server/registry.h"

namespace gem::v1 {
class GetServerStatusResponse;
}

namespace gem {

/// Everything but the release, the backend and the uptime.
void StatusToProto(const Registry& registry, const Metrics& metrics,
                   v1::GetServerStatusResponse* response);

}  // namespace gem
