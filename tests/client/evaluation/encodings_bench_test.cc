#include "client/evaluation/encodings_bench.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "client/simulation/scenes.h"

namespace gem::evaluation {
namespace {

using testing::HasSubstr;

absl::StatusOr<EncodingsBench> Bench(const EncodingsBenchOptions& options, int num_scans) {
  SceneOptions scene;
  scene.name = "block";
  scene.rings = 16;
  scene.azimuths = 256;
  scene.scans_max = num_scans;
  auto source = MakeScene(scene);
  EXPECT_TRUE(source.ok());
  return BenchEncodings(**source, options);
}

TEST(BenchEncodings, MeasuresEveryLayerAndEveryEncodingOfScans) {
  const auto bench = Bench({.num_scans_max = 8}, 20);
  ASSERT_TRUE(bench.ok()) << bench.status();
  EXPECT_EQ(bench->num_scans, 8u);
  ASSERT_EQ(bench->layers.size(), 4u) << "nothing has a colour";
  const LayerCost& elevation = bench->layers[0];
  EXPECT_EQ(elevation.layer, Layer::kElevation);
  EXPECT_GT(elevation.num_cells, 500u);
  // A tile has 16384 cells of 4 bytes and 2048 bytes of bitmap, known or not.
  EXPECT_NEAR(elevation.raw_bytes,
              static_cast<double>(elevation.num_tiles) * (4 * 16384 + 2048) /
                  static_cast<double>(elevation.num_cells),
              1e-9);
  EXPECT_LT(elevation.compact_bytes, elevation.raw_zstd_bytes);
  EXPECT_GT(elevation.compact_bytes, elevation.bitmap_bytes);
  EXPECT_GT(elevation.bitmap_bytes, 0);
  EXPECT_GT(elevation.entropy_bytes, 0);
  EXPECT_LT(elevation.entropy_bytes, 2);

  ASSERT_EQ(bench->scans.size(), 6u);
  EXPECT_EQ(bench->scans[0].encoding, "float32");
  EXPECT_EQ(bench->scans[0].bytes, 12);
  EXPECT_EQ(bench->scans[3].encoding, "int16");
  EXPECT_EQ(bench->scans[3].bytes, 6);
  EXPECT_EQ(bench->scans[5].encoding, "int16 + delta + zstd");
  EXPECT_LT(bench->scans[5].bytes, bench->scans[4].bytes);

  EXPECT_THAT(EncodingsBenchTable(*bench), HasSubstr("int16 + delta + zstd"));
  EXPECT_THAT(EncodingsBenchJson(*bench), HasSubstr("{\"layer\":\"elevation\",\"tiles\":"));
}

TEST(BenchEncodings, SaysWhichPointDoesNotFit) {
  const auto bench = Bench({.int16_step_m = 1e-4}, 1);
  EXPECT_TRUE(absl::IsInvalidArgument(bench.status()));
  EXPECT_THAT(std::string(Bench({.int16_step_m = 2}, 1).status().message()),
              HasSubstr("int16_step_m is 2, want [0.0001, 1]"));
}

}  // namespace
}  // namespace gem::evaluation
