// One ImportMap call: hands the file to a worker message by message, and reads the next one when
// the worker is done with the last: a client is never farther ahead than gRPC's buffers. Never
// blocks.
#pragma once

#include <grpcpp/server_context.h>
#include <grpcpp/support/server_callback.h>

#include <chrono>
#include <optional>

#include "core/base/cancel_token.h"
#include "gem/v1/map_service.pb.h"
#include "server/map_import.h"
#include "server/metrics.h"
#include "server/worker_pool.h"

namespace gem {

/// Deletes itself.
class ImportReactor final : public grpc::ServerReadReactor<v1::ImportMapRequest> {
 public:
  /// All outlive it. response is the call's.
  ImportReactor(const grpc::CallbackServerContext* context, v1::ImportMapResponse* response,
                MapImport import, WorkerPool& pool, MethodMetrics& metrics);

  // On gRPC's threads.
  void OnReadDone(bool ok) override;
  void OnCancel() override { cancel_.Cancel(); }
  void OnDone() override { delete this; }

 private:
  // On a worker; one at a time, as one read is outstanding or one message is being worked on.
  void Take();
  void MakeMap();
  void End(const absl::Status& status);
  void EndWith(const MapActor& map);

  const grpc::CallbackServerContext* const context_;
  v1::ImportMapResponse* const response_;
  std::optional<MapImport> import_;  ///< gone once the call has ended
  WorkerPool& pool_;
  MethodMetrics& metrics_;
  const std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  CancelToken cancel_;
  v1::ImportMapRequest request_;  ///< the read in flight owns it, then the worker
  bool has_begun_ = false;
};

}  // namespace gem
