// Checks of single values from outside: ids, stamps, numbers.
#pragma once

#include <cstdint>
#include <string>

#include "absl/status/status.h"
#include "proto/wire/field_path.h"

namespace gem::wire {

/// Stamps are in [0, kStamp_nsMax]: the difference of any two fits 64 bits. The year is 2096.
inline constexpr std::int64_t kStamp_nsMax = 4'000'000'000'000'000'000;

/// 1 to 64 characters of [A-Za-z0-9_.-], the first a letter or digit.
absl::Status CheckId(const std::string& id, const FieldPath& field);
/// An id, or nothing.
absl::Status CheckRequestId(const std::string& id, const FieldPath& field);
absl::Status CheckStamp(std::int64_t stamp_ns, const FieldPath& field);
/// Finite.
absl::Status CheckFinite(double value, const FieldPath& field);

}  // namespace gem::wire
