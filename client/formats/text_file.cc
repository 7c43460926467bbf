#include "client/formats/text_file.h"

#include <unistd.h>

#include <cerrno>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <system_error>

#include "absl/strings/ascii.h"
#include "absl/strings/charconv.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "core/base/status_macros.h"

namespace gem {
namespace {

// A million poses of 12 numbers take about 150 MB.
constexpr std::uint64_t kTableBytesMax = std::uint64_t{512} << 20;

std::string Quoted(absl::string_view text) {
  constexpr std::size_t kShown = 32;
  return text.size() <= kShown ? absl::StrCat("\"", text, "\"")
                               : absl::StrCat("\"", text.substr(0, kShown), "...\"");
}

absl::Status CannotWrite(const std::string& path, int error) {
  return absl::UnavailableError(
      absl::StrCat(path, ": cannot be written: ", std::generic_category().message(error)));
}

}  // namespace

absl::StatusOr<std::string> ReadFile(const std::string& path, std::uint64_t size_bytes_max) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(path, error))
    return absl::NotFoundError(absl::StrCat(path, ": no such file"));
  const std::uintmax_t size_bytes = std::filesystem::file_size(path, error);
  if (error) return absl::UnavailableError(absl::StrCat(path, ": ", error.message()));
  if (size_bytes > size_bytes_max)
    return absl::InvalidArgumentError(
        absl::StrCat(path, ": ", size_bytes, " bytes, want at most ", size_bytes_max));
  std::ifstream file(path, std::ios::binary);
  std::string contents(size_bytes, '\0');
  file.read(contents.data(), static_cast<std::streamsize>(size_bytes));
  if (!file) return absl::UnavailableError(absl::StrCat(path, ": cannot be read"));
  return contents;
}

absl::Status WriteFileAtomically(const std::string& path, absl::string_view contents) {
  // The process id keeps two writers of the same path apart.
  const std::string temporary = absl::StrCat(path, ".", getpid(), ".tmp");
  std::FILE* file = std::fopen(temporary.c_str(), "wb");
  if (file == nullptr) return CannotWrite(path, errno);
  bool good = std::fwrite(contents.data(), 1, contents.size(), file) == contents.size();
  good = std::fclose(file) == 0 && good;
  if (good && std::rename(temporary.c_str(), path.c_str()) == 0) return absl::OkStatus();
  const int error = errno;
  std::remove(temporary.c_str());
  return CannotWrite(path, error);
}

bool ParseNumber(absl::string_view text, double& value) {
  if (!text.empty() && text.front() == '+') text.remove_prefix(1);
  const absl::from_chars_result result =
      absl::from_chars(text.data(), text.data() + text.size(), value);
  return !text.empty() && result.ec == std::errc() && result.ptr == text.data() + text.size();
}

absl::StatusOr<NumberTable> ReadNumberTable(const std::string& path, std::size_t num_columns) {
  GEM_ASSIGN_OR_RETURN(const std::string contents, ReadFile(path, kTableBytesMax));
  NumberTable table;
  table.num_columns = num_columns;
  std::size_t line_number = 0;
  for (const absl::string_view line : absl::StrSplit(contents, '\n')) {
    ++line_number;
    const absl::string_view text = absl::StripAsciiWhitespace(line);
    if (text.empty() || text.front() == '#') continue;
    std::size_t column = 0;
    for (const absl::string_view word :
         absl::StrSplit(text, absl::ByAnyChar(" \t\r\v\f"), absl::SkipEmpty())) {
      double value = 0;
      ++column;
      if (!ParseNumber(word, value) || !std::isfinite(value))
        return absl::InvalidArgumentError(absl::StrCat(path, ":", line_number, ": number ", column,
                                                       " is ", Quoted(word),
                                                       ", want a finite number"));
      // Surplus numbers are counted for the message, not kept.
      if (column <= num_columns) table.values.push_back(value);
    }
    if (column != num_columns)
      return absl::InvalidArgumentError(
          absl::StrCat(path, ":", line_number, ": ", column, " numbers, want ", num_columns));
    table.lines.push_back(line_number);
  }
  return table;
}

}  // namespace gem
