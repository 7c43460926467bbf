// What every unary call goes through: metrics, deadline, status mapping, and the worker pool for
// what is too heavy for gRPC's callback threads.
#pragma once

#include <google/protobuf/message.h>
#include <grpcpp/server_context.h>
#include <grpcpp/support/byte_buffer.h>
#include <grpcpp/support/server_callback.h>

#include <chrono>
#include <functional>
#include <variant>

#include "absl/status/status.h"
#include "server/metrics.h"
#include "server/worker_pool.h"

namespace gem {

/// A message as gRPC gives and takes it: its own, or bytes.
using AnyMessage = std::variant<const google::protobuf::Message*, const grpc::ByteBuffer*>;

/// What a call reads and writes; both live until it is completed.
struct CallMessages {
  AnyMessage request;
  AnyMessage response;
};

/// One call in progress. Complete() must be called exactly once, from any thread; the request and
/// the response live until then. Deletes itself.
class GuardedCall final : public grpc::ServerUnaryReactor {
 public:
  GuardedCall(grpc::CallbackServerContext* context, const CallMessages& messages,
              MethodMetrics& metrics);
  void Complete(const absl::Status& status);
  /// The client does not wait any more.
  bool abandoned() const;

 private:
  void OnDone() override { delete this; }

  grpc::CallbackServerContext* const context_;
  const CallMessages messages_;
  MethodMetrics& metrics_;
  const std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

class CallGuard {
 public:
  explicit CallGuard(WorkerPool& pool) : pool_(pool) {}

  /// At once, on gRPC's thread: for answers that take microseconds.
  grpc::ServerUnaryReactor* Run(grpc::CallbackServerContext* context, const CallMessages& messages,
                                MethodMetrics& metrics, const std::function<absl::Status()>& work);
  /// On a worker's thread.
  grpc::ServerUnaryReactor* RunInPool(grpc::CallbackServerContext* context,
                                      const CallMessages& messages, MethodMetrics& metrics,
                                      std::function<absl::Status()> work);
  /// Begins on a worker's thread; `work` sees to it that the call is completed, then or later.
  grpc::ServerUnaryReactor* RunAsync(grpc::CallbackServerContext* context,
                                     const CallMessages& messages, MethodMetrics& metrics,
                                     std::function<void(GuardedCall*)> work);

 private:
  WorkerPool& pool_;
};

}  // namespace gem
