#include "client/cli/bench_local.h"

#include <gtest/gtest.h>

namespace gem::client {
namespace {

// Three scans of two points.
class ShortSource : public ScanSource {
 public:
  std::string name() const override { return "short"; }
  std::size_t num_scans() const override { return 3; }
  Pose<Base, Sensor> T_B_S() const override { return {}; }
  NoiseModel noise() const override { return *MakeNoiseModel(LidarNoise()); }
  absl::StatusOr<bool> Next(SourceScan& scan) override {
    if (next_ == 3) return false;
    scan.stamp_ns = ++next_;
    scan.points = {{1, 0, 0, 0}, {0, 1, 0, 0}};
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

TEST(Distribution, TakesTheMedianAndThe95thPercentile) {
  std::vector<double> values_ms;
  for (int i = 100; i >= 0; --i) values_ms.push_back(i);
  EXPECT_EQ(DistributionOf(values_ms).median, 50);
  EXPECT_EQ(DistributionOf(values_ms).p95, 95);
  EXPECT_EQ(DistributionOf({}).median, 0);
}

TEST(BenchJson, HasTheDocumentedFields) {
  LocalBench bench;
  bench.backend = "cpu";
  bench.num_scans = 80;
  bench.points = 121000;
  bench.cells = 1600;
  bench.read_pass_ms = 0.1;
  bench.total = {1.5, 2.5};
  bench.move.median = 0.01;
  bench.measure.median = 0.5;
  bench.fuse.median = 0.25;
  bench.annotate.median = 0.125;
  bench.clear.median = 0.625;
  EXPECT_EQ(BenchJson(bench),
            "{\"backend\":\"cpu\",\"scans\":80,\"points\":121000,\"cells\":1600,"
            "\"read_pass_ms\":0.1000,\"total_ms\":{\"median\":1.5000,\"p95\":2.5000},"
            "\"stages_ms\":{\"move\":0.0100,\"measure\":0.5000,\"fuse\":0.2500,"
            "\"annotate\":0.1250,\"clear\":0.6250}}\n");
}

}  // namespace
}  // namespace gem::client
