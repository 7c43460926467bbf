// Reading and writing small files whole: number tables and exports. Errors name the file, the line
// and the value. Not for scans, which are binary and read one by one.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace gem {

/// The whole file. NOT_FOUND or INVALID_ARGUMENT names the path; a file over size_bytes_max is
/// refused before it is read.
absl::StatusOr<std::string> ReadFile(const std::string& path, std::uint64_t size_bytes_max);

/// Writes `contents` beside `path` and renames it over `path`, so that nobody ever reads half a
/// file.
absl::Status WriteFileAtomically(const std::string& path, absl::string_view contents);

/// Rows of numbers of a text file.
struct NumberTable {
  std::size_t num_columns = 0;
  std::vector<double> values;      ///< by rows; finite
  std::vector<std::size_t> lines;  ///< where each row stands in the file, from 1

  std::size_t num_rows() const { return lines.size(); }
  const double* row(std::size_t index) const { return values.data() + index * num_columns; }
};

/// Reads `num_columns` numbers a line, separated by blanks. Empty lines and lines that begin with
/// '#' are skipped. INVALID_ARGUMENT: "poses.txt:3: 11 numbers, want 12".
absl::StatusOr<NumberTable> ReadNumberTable(const std::string& path, std::size_t num_columns);

/// True if the whole text is a number; it may be infinite or NaN.
bool ParseNumber(absl::string_view text, double& value);

}  // namespace gem
