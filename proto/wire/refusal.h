// How a value from outside is refused: a status whose text is "field is value, want limit" and that
// also carries the field and the reason for programs.
#pragma once

#include <cstdint>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "proto/wire/field_path.h"

namespace gem::wire {

/// Numbers of gem.v1.ProblemReason.
enum class ProblemReason : std::uint8_t {
  kMalformed = 1,
  kUnknownSensor = 2,
  kNoPose = 3,
  kOutOfOrder = 4,
  kTooLarge = 5,
  kDropped = 6,  ///< nothing is wrong with it: newer scans came
};
inline constexpr int kNumProblemReasons = 7;  ///< with 0, which is not used

/// Lower case, for metrics: "malformed", "unknown_sensor", ...
absl::string_view NameOf(ProblemReason reason);

/// INVALID_ARGUMENT "field is value, want limit".
absl::Status Refuse(const FieldPath& field, absl::string_view value, absl::string_view want,
                    ProblemReason reason = ProblemReason::kMalformed);
absl::Status Refuse(const FieldPath& field, double value, absl::string_view want,
                    ProblemReason reason = ProblemReason::kMalformed);

/// Attaches the field (and the reason) to a status that was made elsewhere.
absl::Status WithField(absl::Status status, absl::string_view field,
                       ProblemReason reason = ProblemReason::kMalformed);

/// Path of the refused field; empty if the status names none.
std::string FieldOf(const absl::Status& status);
/// kMalformed if the status carries none.
ProblemReason ReasonOf(const absl::Status& status);

}  // namespace gem::wire
