#include "proto/wire/refusal.h"

#include "absl/strings/cord.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"

namespace gem::wire {
namespace {

constexpr char kFieldUrl[] = "gem/field";
constexpr char kReasonUrl[] = "gem/problem_reason";

}  // namespace

absl::string_view NameOf(ProblemReason reason) {
  switch (reason) {
    case ProblemReason::kMalformed:
      return "malformed";
    case ProblemReason::kUnknownSensor:
      return "unknown_sensor";
    case ProblemReason::kNoPose:
      return "no_pose";
    case ProblemReason::kOutOfOrder:
      return "out_of_order";
    case ProblemReason::kTooLarge:
      return "too_large";
    case ProblemReason::kDropped:
      return "dropped";
  }
  return "malformed";
}

absl::Status Refuse(const FieldPath& field, absl::string_view value, absl::string_view want,
                    ProblemReason reason) {
  const std::string path = field.ToString();
  return WithField(absl::InvalidArgumentError(absl::StrCat(path, " is ", value, ", want ", want)),
                   path, reason);
}

absl::Status Refuse(const FieldPath& field, double value, absl::string_view want,
                    ProblemReason reason) {
  return Refuse(field, absl::StrCat(value), want, reason);
}

absl::Status WithField(absl::Status status, absl::string_view field, ProblemReason reason) {
  status.SetPayload(kFieldUrl, absl::Cord(field));
  status.SetPayload(kReasonUrl, absl::Cord(absl::StrCat(static_cast<int>(reason))));
  return status;
}

std::string FieldOf(const absl::Status& status) {
  const auto payload = status.GetPayload(kFieldUrl);
  return payload.has_value() ? std::string(*payload) : std::string();
}

ProblemReason ReasonOf(const absl::Status& status) {
  const auto payload = status.GetPayload(kReasonUrl);
  int reason = 0;
  if (!payload.has_value() || !absl::SimpleAtoi(std::string(*payload), &reason))
    return ProblemReason::kMalformed;
  return static_cast<ProblemReason>(reason);
}

}  // namespace gem::wire
