#include "server/process_collector.h"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <chrono>
#include <map>
#include <string>
#include <thread>

namespace gem {
namespace {

std::map<std::string, double> Values() {
  std::map<std::string, double> values;
  for (const prometheus::MetricFamily& family : ProcessCollector().Collect()) {
    EXPECT_EQ(family.metric.size(), 1u) << family.name;
    const prometheus::ClientMetric& metric = family.metric.front();
    values[family.name] =
        family.type == prometheus::MetricType::Counter ? metric.counter.value : metric.gauge.value;
  }
  return values;
}

double UnixTime_s() {
  return std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
}

TEST(ProcessCollector, HasTheNamesThatDashboardsOfAnyProcessUse) {
  std::vector<std::string> names;
  for (const auto& [name, value] : Values()) names.push_back(name);
  EXPECT_THAT(names, testing::UnorderedElementsAre(
                         "process_cpu_seconds_total", "process_resident_memory_bytes",
                         "process_virtual_memory_bytes", "process_open_fds", "process_max_fds",
                         "process_threads", "process_start_time_seconds"));
}

TEST(ProcessCollector, CountsDescriptorsAndThreads) {
  const std::map<std::string, double> before = Values();
  const int file = open("/dev/null", O_RDONLY | O_CLOEXEC);
  ASSERT_GE(file, 0);
  std::map<std::string, double> after;
  std::thread([&after] { after = Values(); }).join();
  close(file);
  EXPECT_EQ(after["process_open_fds"], before.at("process_open_fds") + 1);
  EXPECT_EQ(after["process_threads"], before.at("process_threads") + 1);
}

TEST(ProcessCollector, IsPlausible) {
  std::map<std::string, double> values = Values();
  EXPECT_GT(values["process_resident_memory_bytes"], 1e6);
  EXPECT_LT(values["process_resident_memory_bytes"], values["process_virtual_memory_bytes"]);
  EXPECT_LE(values["process_start_time_seconds"], UnixTime_s() + 1);
  EXPECT_GT(values["process_start_time_seconds"], UnixTime_s() - 3600);
  // Work until the clock of the process has moved by at least one tick.
  const double cpu_s = values["process_cpu_seconds_total"];
  while (Values()["process_cpu_seconds_total"] <= cpu_s) {
  }
}

}  // namespace
}  // namespace gem
