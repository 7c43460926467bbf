#include "server/error_reason.h"

#include "absl/strings/cord.h"

namespace gem {
namespace {

constexpr char kErrorReasonUrl[] = "gem/error_reason";

}  // namespace

absl::Status WithErrorReason(absl::Status status, absl::string_view reason) {
  status.SetPayload(kErrorReasonUrl, absl::Cord(reason));
  return status;
}

std::string ErrorReasonOf(const absl::Status& status) {
  const auto payload = status.GetPayload(kErrorReasonUrl);
  return payload.has_value() ? std::string(*payload) : std::string();
}

}  // namespace gem
