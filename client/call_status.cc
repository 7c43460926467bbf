#include "client/call_status.h"

#include <grpcpp/grpcpp.h>

#include "absl/strings/cord.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "google/rpc/error_details.pb.h"

namespace gem::client {
namespace {

constexpr char kReasonUrl[] = "gem/error_reason";
constexpr char kRevisionExpired[] = "REVISION_EXPIRED";

/// Calls `visit` with each detail of the given type.
template <typename Detail, typename Visitor>
void VisitDetails(const grpc::Status& status, Visitor visit) {
  google::rpc::Status details;
  // Details that cannot be read are details that are not there: the text says enough.
  if (!details.ParseFromString(status.error_details())) return;
  for (const google::protobuf::Any& any : details.details()) {
    Detail detail;
    if (any.Is<Detail>() && any.UnpackTo(&detail)) visit(detail);
  }
}

}  // namespace

absl::Status ToStatus(const grpc::Status& status, const std::string& address) {
  if (status.ok()) return absl::OkStatus();
  std::string text = status.error_message();
  VisitDetails<google::rpc::BadRequest>(status, [&](const google::rpc::BadRequest& request) {
    for (const auto& violation : request.field_violations()) {
      if (absl::StrContains(text, violation.field())) continue;
      absl::StrAppend(&text, "; ", violation.field(), ": ", violation.description());
    }
  });
  if (status.error_code() == grpc::StatusCode::UNAVAILABLE)
    text = absl::StrCat("server ", address, ": ", text);
  // The numbers of both enums are those of google.rpc.Code.
  absl::Status result(static_cast<absl::StatusCode>(status.error_code()), text);
  VisitDetails<google::rpc::ErrorInfo>(status, [&](const google::rpc::ErrorInfo& info) {
    result.SetPayload(kReasonUrl, absl::Cord(info.reason()));
  });
  return result;
}

absl::Status DamageError(const std::string& address) {
  return absl::UnavailableError(
      absl::StrCat("server ", address, ": its answer is damaged, or it is no GEM server"));
}

bool IsRevisionExpired(const absl::Status& status) {
  return status.GetPayload(kReasonUrl) == absl::Cord(kRevisionExpired);
}

std::optional<double> RetryAfter_s(const grpc::Status& status) {
  std::optional<double> retry_after_s;
  VisitDetails<google::rpc::RetryInfo>(status, [&](const google::rpc::RetryInfo& info) {
    retry_after_s = static_cast<double>(info.retry_delay().seconds()) +
                    static_cast<double>(info.retry_delay().nanos()) * 1e-9;
  });
  return retry_after_s;
}

bool IsTransient(const absl::Status& status) {
  switch (status.code()) {
    case absl::StatusCode::kUnavailable:
    case absl::StatusCode::kCancelled:
    case absl::StatusCode::kDeadlineExceeded:
    case absl::StatusCode::kResourceExhausted:
    case absl::StatusCode::kInternal:
    case absl::StatusCode::kUnknown:
      return true;
    default:
      return false;
  }
}

}  // namespace gem::client
