// One zstd frame for one buffer of known size: what cells and scans are compressed with. Inflating
// is bounded before it begins.
#pragma once

#include <cstddef>
#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "proto/wire/field_path.h"

namespace gem::wire {

/// One frame with its content size in the header. The same data and level give the same bytes.
std::string Compressed(absl::string_view data, int level);

/// Refuses what is not exactly one intact frame whose header claims size_bytes; nothing is
/// allocated before that is known.
absl::StatusOr<std::string> Inflated(absl::string_view frame, std::size_t size_bytes,
                                     const FieldPath& field);

}  // namespace gem::wire
