#include "client/evaluation/local_bench.h"

#include <gtest/gtest.h>

#include <vector>

namespace gem::evaluation {
namespace {

// Three scans of two points, one of them outside of a window of 8 m.
class ShortSource : public ScanSource {
 public:
  std::string name() const override { return "short"; }
  std::size_t num_scans() const override { return 3; }
  Pose<Base, Sensor> T_B_S() const override { return {}; }
  NoiseModel noise() const override { return *MakeNoiseModel(LidarNoise()); }
  absl::StatusOr<bool> Next(SourceScan& scan) override {
    if (next_ == 3) return false;
    scan.stamp_ns = ++next_;
    scan.points = {{1, 0, 0, 0}, {0, 9, 0, 0}};
    return true;
  }

 private:
  int next_ = 0;
};

TEST(BenchLocal, RunsOverEveryScanOrAsManyAsAsked) {
  ShortSource all, some;
  const auto bench = BenchLocal(all, LocalBackend::kCpu, LocalMapOptions(), 100);
  ASSERT_TRUE(bench.ok()) << bench.status();
  EXPECT_EQ(bench->num_scans, 3u);
  EXPECT_EQ(bench->points, 2u);
  EXPECT_EQ(bench->points_in_window, 1u);
  EXPECT_EQ(bench->cells, 1600u);
  EXPECT_GT(bench->total.median, 0);
  EXPECT_EQ(BenchLocal(some, LocalBackend::kReference, LocalMapOptions(), 2)->num_scans, 2u);
}

TEST(BenchLocal, RefusesBadOptionsAndSourcesWithoutScans) {
  ShortSource source;
  LocalMapOptions options;
  options.cell_size_m = 0;
  EXPECT_EQ(BenchLocal(source, LocalBackend::kCpu, options, 1).status().code(),
            absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(BenchLocal(source, LocalBackend::kCpu, LocalMapOptions(), 0).status().message(),
            "short has no scans");
}

TEST(Summarise, TakesMediansStageByStage) {
  std::vector<ScanTiming> scans(3);
  for (std::size_t i = 0; i < scans.size(); ++i) {
    scans[i].read_pass_s = 1e-4;
    scans[i].report.points = 100 + i;
    scans[i].report.points_fused = 10;
    scans[i].report.points_gated = i;
    scans[i].report.seconds.measure = 1e-3 * static_cast<double>(i + 1);
    scans[i].report.seconds.clear = 1e-3 * static_cast<double>(10 - i);
  }
  const LocalBench bench = Summarise(LocalBackend::kReference, LocalMapOptions(), scans);
  EXPECT_EQ(bench.backend, "reference");
  EXPECT_EQ(bench.num_scans, 3u);
  EXPECT_EQ(bench.points, 101u);
  EXPECT_EQ(bench.points_in_window, 11u);
  EXPECT_EQ(bench.cells, 1600u);
  EXPECT_DOUBLE_EQ(bench.measure.median, 2);
  EXPECT_DOUBLE_EQ(bench.clear.median, 9);
  EXPECT_DOUBLE_EQ(bench.total.median, 11);
  EXPECT_DOUBLE_EQ(bench.read_pass_ms, 0.1);
}

TEST(Distribution, TakesTheMedianAndThe95thPercentile) {
  std::vector<double> values_ms;
  for (int i = 100; i >= 0; --i) values_ms.push_back(i);
  EXPECT_EQ(DistributionOf(values_ms).median, 50);
  EXPECT_EQ(DistributionOf(values_ms).p95, 95);
  EXPECT_EQ(DistributionOf({}).median, 0);
}

}  // namespace
}  // namespace gem::evaluation
