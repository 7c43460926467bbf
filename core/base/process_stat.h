// What Linux tells of a process: processor time, memory, threads, open files. Knows no metrics; the
// server shows its own, tests and benchmarks watch another process.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

namespace gem {

struct ProcessStat {
  double cpu_s = 0;  ///< in user and system mode, since the start
  std::uint64_t virtual_bytes = 0;
  std::uint64_t resident_bytes = 0;
  int num_threads = 0;
  double start_s = 0;  ///< after the machine's boot
};

/// The entry of a process in /proc; `process` is its number or "self". Nothing if it has none.
std::optional<ProcessStat> ReadProcessStat(const std::string& process = "self");

/// Open file descriptors; nothing if they may not be seen.
std::optional<int> CountOpenFiles(const std::string& process = "self");

}  // namespace gem
