#include "server/status_mapping.h"

#include <cmath>

#include "google/rpc/error_details.pb.h"
#include "proto/wire/refusal.h"
#include "server/error_reason.h"
#include "server/retry.h"

namespace gem {
namespace {

void AddDetail(const google::protobuf::Message& detail, google::rpc::Status* details) {
  details->add_details()->PackFrom(detail);
}

}  // namespace

grpc::Status ToGrpc(const absl::Status& status) {
  if (status.ok()) return grpc::Status::OK;
  // Abseil took its codes from gRPC.
  const auto code = static_cast<grpc::StatusCode>(status.code());
  const std::string message(status.message());
  google::rpc::Status details;
  details.set_code(static_cast<int>(code));
  details.set_message(message);
  if (const std::string field = wire::FieldOf(status); !field.empty()) {
    google::rpc::BadRequest bad_request;
    auto* violation = bad_request.add_field_violations();
    violation->set_field(field);
    violation->set_description(message);
    AddDetail(bad_request, &details);
  }
  if (const auto retry_after_s = RetryAfterSeconds(status)) {
    google::rpc::RetryInfo retry;
    const double whole_s = std::floor(*retry_after_s);
    retry.mutable_retry_delay()->set_seconds(static_cast<std::int64_t>(whole_s));
    retry.mutable_retry_delay()->set_nanos(
        static_cast<std::int32_t>((*retry_after_s - whole_s) * 1e9));
    AddDetail(retry, &details);
  }
  if (const std::string reason = ErrorReasonOf(status); !reason.empty()) {
    google::rpc::ErrorInfo info;
    info.set_reason(reason);
    info.set_domain("gem");
    AddDetail(info, &details);
  }
  if (details.details().empty()) return {code, message};
  return {code, message, details.SerializeAsString()};
}

std::string CodeName(const absl::Status& status) { return absl::StatusCodeToString(status.code()); }

}  // namespace gem
