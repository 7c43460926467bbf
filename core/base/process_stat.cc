#include "core/base/process_stat.h"

#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <system_error>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_split.h"

namespace gem {

std::optional<ProcessStat> ReadProcessStat(const std::string& process) {
  std::ifstream file("/proc/" + process + "/stat");
  const std::string text{std::istreambuf_iterator<char>(file), {}};
  // The second field is the program's name in parentheses, which may hold anything.
  const std::size_t name_end = text.rfind(") ");
  if (name_end == std::string::npos) return std::nullopt;
  const std::vector<std::string> fields = absl::StrSplit(text.substr(name_end + 2), ' ');
  // Numbers of fields as proc(5) counts them.
  const auto read = [&fields](std::size_t number, double& to) {
    const std::size_t i = number - 3;
    return i < fields.size() && absl::SimpleAtod(fields[i], &to);
  };
  double user_ticks, system_ticks, num_threads, start_ticks, virtual_bytes, resident_pages;
  if (!read(14, user_ticks) || !read(15, system_ticks) || !read(20, num_threads) ||
      !read(22, start_ticks) || !read(23, virtual_bytes) || !read(24, resident_pages))
    return std::nullopt;
  const double ticks_per_s = static_cast<double>(sysconf(_SC_CLK_TCK));
  const double page_bytes = static_cast<double>(sysconf(_SC_PAGESIZE));
  return ProcessStat{(user_ticks + system_ticks) / ticks_per_s,
                     static_cast<std::uint64_t>(virtual_bytes),
                     static_cast<std::uint64_t>(resident_pages * page_bytes),
                     static_cast<int>(num_threads), start_ticks / ticks_per_s};
}

std::optional<int> CountOpenFiles(const std::string& process) {
  std::error_code error;
  const std::filesystem::directory_iterator files("/proc/" + process + "/fd", error);
  if (error) return std::nullopt;
  const auto num_files = static_cast<int>(std::distance(begin(files), end(files)));
  // Without the descriptor that looks.
  return process == "self" ? num_files - 1 : num_files;
}

}  // namespace gem
