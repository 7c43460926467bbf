#include "server/retry.h"

#include <string>

#include "absl/strings/cord.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"

namespace gem {
namespace {

constexpr char kRetryUrl[] = "gem/retry_after_s";

}  // namespace

absl::Status WithRetry(absl::Status status, double after_s) {
  status.SetPayload(kRetryUrl, absl::Cord(absl::StrCat(after_s)));
  return status;
}

std::optional<double> RetryAfterSeconds(const absl::Status& status) {
  const auto payload = status.GetPayload(kRetryUrl);
  double after_s = 0;
  if (!payload.has_value() || !absl::SimpleAtod(std::string(*payload), &after_s))
    return std::nullopt;
  return after_s;
}

}  // namespace gem
