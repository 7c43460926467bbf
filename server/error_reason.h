// A reason that programs can tell apart where the code alone does not say enough: carried by the
// status, written into google.rpc.ErrorInfo.
#pragma once

#include <string>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"

namespace gem {

/// The version is too old to be read, or of another epoch: read the newest.
inline constexpr absl::string_view kRevisionExpired = "REVISION_EXPIRED";

/// reason: UPPER_SNAKE_CASE.
absl::Status WithErrorReason(absl::Status status, absl::string_view reason);
/// Empty if the status carries none.
std::string ErrorReasonOf(const absl::Status& status);

}  // namespace gem
