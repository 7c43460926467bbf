#include "server/process_collector.h"

#include <sys/resource.h>
#include <unistd.h>

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <optional>
#include <string>
#include <system_error>

#include "absl/strings/numbers.h"
#include "absl/strings/str_split.h"

namespace gem {
namespace {

using prometheus::MetricFamily;

/// The fields of /proc/self/stat that are shown, as proc(5) counts them.
struct ProcStat {
  double user_ticks = 0;      // 14
  double system_ticks = 0;    // 15
  double num_threads = 0;     // 20
  double start_ticks = 0;     // 22, since boot
  double virtual_bytes = 0;   // 23
  double resident_pages = 0;  // 24
};

std::optional<ProcStat> ReadStat() {
  std::ifstream file("/proc/self/stat");
  const std::string text{std::istreambuf_iterator<char>(file), {}};
  // The second field is the program's name in parentheses, which may hold anything.
  const std::size_t name_end = text.rfind(") ");
  if (name_end == std::string::npos) return std::nullopt;
  const std::vector<std::string> fields = absl::StrSplit(text.substr(name_end + 2), ' ');
  const auto read = [&fields](std::size_t number, double& to) {
    const std::size_t i = number - 3;
    return i < fields.size() && absl::SimpleAtod(fields[i], &to);
  };
  ProcStat stat;
  const bool complete = read(14, stat.user_ticks) && read(15, stat.system_ticks) &&
                        read(20, stat.num_threads) && read(22, stat.start_ticks) &&
                        read(23, stat.virtual_bytes) && read(24, stat.resident_pages);
  return complete ? std::optional(stat) : std::nullopt;
}

double TicksPerSecond() { return static_cast<double>(sysconf(_SC_CLK_TCK)); }

std::optional<double> StartTime_s() {
  const std::optional<ProcStat> stat = ReadStat();
  std::ifstream file("/proc/stat");
  double boot_s = 0;
  for (std::string word; stat.has_value() && file >> word;)
    if (word == "btime" && file >> boot_s) return boot_s + stat->start_ticks / TicksPerSecond();
  return std::nullopt;
}

std::optional<double> CountOpenFiles() {
  std::error_code error;
  const std::filesystem::directory_iterator files("/proc/self/fd", error);
  if (error) return std::nullopt;
  // Without the descriptor that looks.
  return static_cast<double>(std::distance(begin(files), end(files)) - 1);
}

void Append(std::vector<MetricFamily>& families, const char* name, const char* help,
            std::optional<double> value) {
  if (!value.has_value()) return;
  prometheus::ClientMetric metric;
  metric.gauge.value = *value;
  families.push_back({name, help, prometheus::MetricType::Gauge, {metric}});
}

}  // namespace

ProcessCollector::ProcessCollector() : start_time_s_(StartTime_s()) {}

std::vector<MetricFamily> ProcessCollector::Collect() const {
  const double ticks_per_s = TicksPerSecond();
  std::vector<MetricFamily> families;
  if (const std::optional<ProcStat> stat = ReadStat()) {
    prometheus::ClientMetric cpu;
    cpu.counter.value = (stat->user_ticks + stat->system_ticks) / ticks_per_s;
    families.push_back({"process_cpu_seconds_total",
                        "Processor time of the process, in user and system mode",
                        prometheus::MetricType::Counter,
                        {cpu}});
    Append(families, "process_resident_memory_bytes", "Memory that is resident",
           stat->resident_pages * static_cast<double>(sysconf(_SC_PAGESIZE)));
    Append(families, "process_virtual_memory_bytes", "Address space", stat->virtual_bytes);
    Append(families, "process_threads", "Threads of the process", stat->num_threads);
  }
  Append(families, "process_start_time_seconds", "Start of the process, Unix time", start_time_s_);
  Append(families, "process_open_fds", "Open file descriptors", CountOpenFiles());
  rlimit limit{};
  if (getrlimit(RLIMIT_NOFILE, &limit) == 0)
    Append(families, "process_max_fds", "How many file descriptors may be open",
           static_cast<double>(limit.rlim_cur));
  return families;
}

}  // namespace gem
