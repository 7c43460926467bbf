#include "client/cli/bench_local.h"

#include <gtest/gtest.h>

namespace gem::client {
namespace {

TEST(BenchJson, HasTheDocumentedFields) {
  evaluation::LocalBench bench;
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
