// What Prometheus's own client libraries show of a process, under the same names: processor time,
// memory, file descriptors, threads, start. Read from /proc when it is asked for.
#pragma once

#include <prometheus/collectable.h>
#include <prometheus/metric_family.h>

#include <optional>
#include <vector>

namespace gem {

class ProcessCollector final : public prometheus::Collectable {
 public:
  ProcessCollector();
  /// process_cpu_seconds_total, process_resident_memory_bytes, process_virtual_memory_bytes,
  /// process_open_fds, process_max_fds, process_threads, process_start_time_seconds. What /proc
  /// does not tell is left out.
  std::vector<prometheus::MetricFamily> Collect() const override;

 private:
  /// Constant: the time of boot that /proc tells moves when the clock is set, and who watches for
  /// restarts would see one.
  const std::optional<double> start_time_s_;
};

}  // namespace gem
