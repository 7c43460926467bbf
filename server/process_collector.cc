#include "server/process_collector.h"

#include <sys/resource.h>

#include <fstream>
#include <optional>
#include <string>

#include "core/base/process_stat.h"

namespace gem {
namespace {

using prometheus::MetricFamily;

std::optional<double> StartTime_s() {
  const std::optional<ProcessStat> stat = ReadProcessStat();
  std::ifstream file("/proc/stat");
  double boot_s = 0;
  for (std::string word; stat.has_value() && file >> word;)
    if (word == "btime" && file >> boot_s) return boot_s + stat->start_s;
  return std::nullopt;
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
  std::vector<MetricFamily> families;
  if (const std::optional<ProcessStat> stat = ReadProcessStat()) {
    prometheus::ClientMetric cpu;
    cpu.counter.value = stat->cpu_s;
    families.push_back({"process_cpu_seconds_total",
                        "Processor time of the process, in user and system mode",
                        prometheus::MetricType::Counter,
                        {cpu}});
    Append(families, "process_resident_memory_bytes", "Memory that is resident",
           static_cast<double>(stat->resident_bytes));
    Append(families, "process_virtual_memory_bytes", "Address space",
           static_cast<double>(stat->virtual_bytes));
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
