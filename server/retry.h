// Says when a refused caller may come back: carried by the status, written into
// google.rpc.RetryInfo.
#pragma once

#include <optional>

#include "absl/status/status.h"

namespace gem {

absl::Status WithRetry(absl::Status status, double after_s);
/// Nothing if the status does not say.
std::optional<double> RetryAfterSeconds(const absl::Status& status);

}  // namespace gem
