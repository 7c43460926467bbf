// Refuses options of a benchmark that are out of range, by name.
#pragma once

#include "absl/status/status.h"
#include "absl/strings/str_format.h"

namespace gem::evaluation {

/// INVALID_ARGUMENT: "way_m is 1, want [100, 100000]".
inline absl::Status CheckRange(const char* option, double value, double low, double high) {
  if (value >= low && value <= high) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrFormat("%s is %g, want [%g, %g]", option, value, low, high));
}

}  // namespace gem::evaluation
