#include "server/metrics.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <set>
#include <string>

namespace gem {
namespace {

/// What the page shows of a family; empty if there is none.
prometheus::MetricFamily FamilyOf(const Metrics& metrics, const std::string& name) {
  for (prometheus::MetricFamily& family : metrics.registry()->Collect())
    if (family.name == name) return std::move(family);
  return {};
}

double GaugeOf(const Metrics& metrics, const std::string& name) {
  const prometheus::MetricFamily family = FamilyOf(metrics, name);
  return family.metric.size() == 1 ? family.metric.front().gauge.value : -1;
}

std::set<double> EdgesOf(const Metrics& metrics, const std::string& name) {
  std::set<double> edges;
  for (const prometheus::ClientMetric& metric : FamilyOf(metrics, name).metric)
    for (const auto& bucket : metric.histogram.bucket) edges.insert(bucket.upper_bound);
  return edges;
}

TEST(Metrics, EveryObjectiveIsAnEdge) {
  Metrics metrics;
  metrics.AddMethod("BatchGetTiles");
  for (const char* name : {"gem_scan_seconds", "gem_correction_seconds", "gem_rpc_seconds",
                           "gem_local_stage_seconds", "gem_global_stage_seconds"})
    EXPECT_THAT(EdgesOf(metrics, name), testing::Contains(0.1)) << name;
  EXPECT_THAT(EdgesOf(metrics, "gem_rpc_seconds"), testing::Contains(0.005));
  EXPECT_THAT(EdgesOf(metrics, "gem_scan_seconds"), testing::Contains(0.2));  // pose_wait_s_max
}

TEST(Metrics, HistogramsHaveNoLabelThatClientsChoose) {
  Metrics metrics;
  metrics.AddMethod("Ingest");
  for (const prometheus::MetricFamily& family : metrics.registry()->Collect()) {
    if (family.type != prometheus::MetricType::Histogram) continue;
    for (const prometheus::ClientMetric& metric : family.metric)
      for (const auto& label : metric.label)
        EXPECT_THAT(label.name, testing::AnyOf("stage", "method")) << family.name;
  }
}

TEST(Metrics, EveryNameSaysWhoseItIs) {
  Metrics metrics;
  for (const prometheus::MetricFamily& family : metrics.registry()->Collect()) {
    EXPECT_THAT(family.name, testing::StartsWith("gem_"));
    EXPECT_FALSE(family.help.empty()) << family.name;
  }
}

TEST(MethodMetrics, ACallIsActiveUntilItEnds) {
  Metrics metrics;
  MethodMetrics& method = metrics.AddMethod("GetMap");
  method.Begin();
  method.Begin();
  EXPECT_EQ(GaugeOf(metrics, "gem_rpc_active_calls"), 2);
  method.End("NOT_FOUND", 0.001);
  EXPECT_EQ(GaugeOf(metrics, "gem_rpc_active_calls"), 1);
  EXPECT_EQ(FamilyOf(metrics, "gem_rpc_started_total").metric.front().counter.value, 2);
  // OK is there from the start, so that a rate has a zero to begin with.
  EXPECT_EQ(FamilyOf(metrics, "gem_rpc_total").metric.size(), 2u);
}

}  // namespace
}  // namespace gem
