// One stream of a watch from its opening to its end. Private to the library.
#pragma once

#include <grpcpp/grpcpp.h>

#include <memory>
#include <string>
#include <utility>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/call_status.h"
#include "client/calls/read_message.h"
#include "client/retry_thread.h"
#include "client/watch_state.h"

namespace gem::client {

/// A context that an interrupt cancels while the object lives.
class CallContext {
 public:
  explicit CallContext(Interrupt& interrupt) : interrupt_(interrupt) {
    if (!interrupt_.Arm([this] { context_.TryCancel(); })) context_.TryCancel();
  }
  ~CallContext() { interrupt_.Disarm(); }
  CallContext(const CallContext&) = delete;
  CallContext& operator=(const CallContext&) = delete;

  grpc::ClientContext* get() { return &context_; }

 private:
  Interrupt& interrupt_;
  grpc::ClientContext context_;
};

/// Asking the same again would be answered the same again.
inline bool IsFinal(const absl::Status& status) {
  switch (status.code()) {
    case absl::StatusCode::kInvalidArgument:
    case absl::StatusCode::kOutOfRange:
    case absl::StatusCode::kPermissionDenied:
    case absl::StatusCode::kUnauthenticated:
    case absl::StatusCode::kUnimplemented:
      return true;
    default:
      return false;
  }
}

/// What the library made of a message.
enum class Taken {
  kPart,      ///< the rest is to come
  kComplete,  ///< what is held is up to date
};

/// Reads to the end of the stream. open(context) opens it; take(response) says Taken, or an error
/// that ends the stream and is final if it is RESOURCE_EXHAUSTED: that is a limit of ours.
template <typename Response, typename Open, typename Take>
RetryThread::Outcome RunStream(Interrupt& interrupt, const std::string& address, WatchState& state,
                               Open open, Take take) {
  RetryThread::Outcome outcome;
  CallContext context(interrupt);
  const std::unique_ptr<grpc::ClientReader<Response>> reader = open(context.get());
  absl::Status ours;
  Response response;
  for (bool first = true;; first = false) {
    const Got got = ReadMessage(*reader, response);
    if (got == Got::kEnd) break;
    const absl::StatusOr<Taken> taken =
        got == Got::kMessage ? take(response) : DamageError(address);
    ours = taken.status();
    if (!ours.ok()) {
      context.get()->TryCancel();
      break;
    }
    state.Receive(response.ByteSizeLong(), first, *taken == Taken::kPart);
    outcome.progressed = outcome.progressed || *taken == Taken::kComplete;
  }
  const grpc::Status status = reader->Finish();
  outcome.status = ours.ok() ? ToStatus(status, address) : ours;
  if (outcome.status.ok()) outcome.status = absl::UnavailableError("the server ended the stream");
  outcome.final = ours.ok() ? IsFinal(outcome.status) : absl::IsResourceExhausted(ours);
  outcome.retry_after_s = RetryAfter_s(status);
  return outcome;
}

}  // namespace gem::client
