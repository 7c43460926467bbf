// gem.v1.IngestService: scans, poses and corrections in.
#pragma once

#include "gem/v1/ingest_service.grpc.pb.h"
#include "server/call_guard.h"
#include "server/ingest_reactor.h"
#include "server/options.h"
#include "server/registry.h"

namespace gem {

class IngestService final : public v1::IngestService::CallbackService {
 public:
  /// Everything outlives the service. guard: for corrections.
  IngestService(Registry& registry, const ServerOptions& options, Metrics& metrics,
                CallGuard& guard);

  grpc::ServerBidiReactor<v1::IngestRequest, v1::IngestResponse>* Ingest(
      grpc::CallbackServerContext* context) override;
  grpc::ServerUnaryReactor* CorrectTrajectory(grpc::CallbackServerContext* context,
                                              const v1::CorrectTrajectoryRequest* request,
                                              v1::CorrectTrajectoryResponse* response) override;

  /// Ends all streams with UNAVAILABLE.
  void DrainAll() { streams_.DrainAll(); }

 private:
  Registry& registry_;
  const ServerOptions& options_;
  CallGuard& guard_;
  MethodMetrics& ingest_;
  MethodMetrics& correct_trajectory_;
  IngestStreams streams_;
};

}  // namespace gem
