#include "server/call_guard.h"

#include <utility>

#include "server/status_mapping.h"

namespace gem {
namespace {

std::size_t BytesOf(const AnyMessage& message) {
  if (const auto* bytes = std::get_if<const grpc::ByteBuffer*>(&message)) return (*bytes)->Length();
  return std::get<const google::protobuf::Message*>(message)->ByteSizeLong();
}

}  // namespace

GuardedCall::GuardedCall(grpc::CallbackServerContext* context, const CallMessages& messages,
                         MethodMetrics& metrics)
    : context_(context), messages_(messages), metrics_(metrics) {
  metrics_.Begin();
  metrics_.CountReceived(BytesOf(messages_.request));
}

void GuardedCall::Complete(const absl::Status& status) {
  const double seconds =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
  // The response of a call that failed is not sent.
  if (status.ok()) metrics_.CountSent(BytesOf(messages_.response));
  metrics_.End(CodeName(status), seconds);
  Finish(ToGrpc(status));
}

bool GuardedCall::abandoned() const {
  return context_->IsCancelled() || context_->deadline() <= std::chrono::system_clock::now();
}

grpc::ServerUnaryReactor* CallGuard::Run(grpc::CallbackServerContext* context,
                                         const CallMessages& messages, MethodMetrics& metrics,
                                         const std::function<absl::Status()>& work) {
  auto* call = new GuardedCall(context, messages, metrics);
  call->Complete(work());
  return call;
}

grpc::ServerUnaryReactor* CallGuard::RunInPool(grpc::CallbackServerContext* context,
                                               const CallMessages& messages, MethodMetrics& metrics,
                                               std::function<absl::Status()> work) {
  return RunAsync(context, messages, metrics,
                  [work = std::move(work)](GuardedCall* call) { call->Complete(work()); });
}

grpc::ServerUnaryReactor* CallGuard::RunAsync(grpc::CallbackServerContext* context,
                                              const CallMessages& messages, MethodMetrics& metrics,
                                              std::function<void(GuardedCall*)> work) {
  auto* call = new GuardedCall(context, messages, metrics);
  const absl::Status queued = pool_.Submit([call, work = std::move(work)] {
    // It may have waited longer than its caller.
    if (call->abandoned()) {
      call->Complete(absl::DeadlineExceededError("the deadline passed while the call waited"));
    } else {
      work(call);
    }
  });
  if (!queued.ok()) call->Complete(queued);
  return call;
}

}  // namespace gem
