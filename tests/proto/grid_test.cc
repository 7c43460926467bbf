#include "proto/wire/grid.h"

#include <zstd.h>

#include <array>
#include <cmath>
#include <cstring>
#include <limits>

#include "gem/v1/types.pb.h"
#include "proto/wire/zstd_frame.h"
#include "tests/proto/refused.h"

namespace gem::wire {
namespace {

/// 3 x 2 cells; cell 4 is unknown.
LayeredGrid SmallGrid() {
  LayeredGrid grid{3, 2, 0.2, {}};
  grid.layers.push_back(
      {Layer::kElevation, {1, 1, 1, 1, 0, 1}, {-1.5f, 0, 2.25f, 100.125f, 0, 7}, {}});
  grid.layers.push_back({Layer::kColor, {0, 0, 1, 0, 0, 0}, {}, {0, 0, 0xff0000aa, 0, 0, 0}});
  return grid;
}

v1::Grid Encoded(const LayeredGrid& grid, CellEncoding encoding) {
  v1::Grid proto;
  ToProto(grid, encoding, &proto);
  return proto;
}

absl::StatusOr<LayeredGrid> Decode(const v1::Grid& proto, std::int32_t side_cells_max = 1024) {
  return FromProto(proto, side_cells_max, FieldPath("grid"));
}

TEST(Grid, RawIsAnExactCopy) {
  const LayeredGrid grid = SmallGrid();
  const auto back = Decode(Encoded(grid, CellEncoding::kRaw));
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ(back->columns, 3);
  EXPECT_EQ(back->rows, 2);
  EXPECT_EQ(back->cell_size_m, 0.2);
  EXPECT_EQ(back->layers, grid.layers);
}

TEST(Grid, LiesByRowsFromTheLowerLeftWithTheLowestBitFirst) {
  const v1::Grid proto = Encoded(SmallGrid(), CellEncoding::kRaw);
  EXPECT_EQ(proto.layers(0).valid_bitmap(), std::string("\x2f", 1));  // 0b101111
  float cell_0_1 = 0;                                                 // column 0, row 1: index 3
  std::memcpy(&cell_0_1, proto.layers(0).data().data() + 3 * sizeof(float), sizeof(float));
  EXPECT_EQ(cell_0_1, 100.125f);
}

TEST(Grid, CompactKeepsHeightsToHalfAMillimetreWithinSixtyFiveMetres) {
  LayeredGrid grid{2, 1, 0.2, {}};
  grid.layers.push_back({Layer::kElevation, {1, 1}, {0.1234f, 60.0f}, {}});
  const v1::Grid proto = Encoded(grid, CellEncoding::kCompact);
  EXPECT_EQ(proto.layers(0).scale(), 1e-3);
  const auto back = Decode(proto);
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_NEAR(back->layers[0].values[0], 0.1234f, 0.00051);
  EXPECT_NEAR(back->layers[0].values[1], 60.0f, 0.00051);
}

TEST(Grid, CompactCoarsensTheStepWhereHeightsSpanMore) {
  LayeredGrid grid{2, 1, 0.2, {}};
  // 655.0 m / 65532 steps = 9.995 mm: the next multiple of 1 mm, so that what neighbouring tiles
  // have in common is rounded to common heights.
  grid.layers.push_back({Layer::kElevation, {1, 1}, {-400.0f, 255.0f}, {}});
  const v1::Grid proto = Encoded(grid, CellEncoding::kCompact);
  EXPECT_NEAR(proto.layers(0).scale(), 0.01, 1e-12);
  const auto back = Decode(proto);
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_NEAR(back->layers[0].values[0], -400.0f, 0.0051);
  EXPECT_NEAR(back->layers[0].values[1], 255.0f, 0.0051);
}

TEST(Grid, CompactKeepsColoursAndValidityExactly) {
  const LayeredGrid grid = SmallGrid();
  const auto back = Decode(Encoded(grid, CellEncoding::kCompact));
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ(back->layers[0].valid, grid.layers[0].valid);
  EXPECT_EQ(back->layers[0].values[4], 0);
  EXPECT_EQ(back->layers[1], grid.layers[1]);
}

TEST(Grid, CompactNeverMakesACellFreerThanItIs) {
  LayeredGrid grid{2, 1, 0.2, {}};
  // The second is just below the threshold 0.7: rounding to nearest would say 0.7000.
  grid.layers.push_back({Layer::kTraversability, {1, 1}, {0.2f, 0.69996f}, {}});
  const auto back = Decode(Encoded(grid, CellEncoding::kCompact));
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_LE(back->layers[0].values[0], 0.2f);
  EXPECT_LT(back->layers[0].values[1], 0.69996f);
  EXPECT_NEAR(back->layers[0].values[1], 0.6999f, 1e-5);
}

TEST(Grid, CompactNeverMakesAHeightSurerThanItIs) {
  // Of a wide range of variances the step is 5 / 65532: the small one must not become 0, or less.
  LayeredGrid grid{2, 1, 0.2, {}};
  grid.layers.push_back({Layer::kVariance, {1, 1}, {1e-4f, 5.0f}, {}});
  const auto back = Decode(Encoded(grid, CellEncoding::kCompact));
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_GE(back->layers[0].values[0], 1e-4f);
  EXPECT_LE(back->layers[0].values[0], 2e-4f);
  EXPECT_GE(back->layers[0].values[1], 5.0f);
}

TEST(Grid, NeighboursAgreeToTheBitWhereTheirHeightsDo) {
  // The same height in tiles whose other heights differ: no step between them but the terrain's.
  for (const float common_m : {0.1234f, -7.7777f, 12.0005f}) {
    std::vector<float> decoded;
    for (const float other_m : {-20.123f, 3.3333f, 31.0007f}) {
      LayeredGrid grid{2, 1, 0.2, {}};
      grid.layers.push_back({Layer::kElevation, {1, 1}, {common_m, other_m}, {}});
      const auto back = Decode(Encoded(grid, CellEncoding::kCompact));
      ASSERT_TRUE(back.ok()) << back.status();
      decoded.push_back(back->layers[0].values[0]);
    }
    EXPECT_EQ(decoded[0], decoded[1]);
    EXPECT_EQ(decoded[0], decoded[2]);
  }
}

TEST(Grid, TakesCellsThatAreCompressedButNotPredicted) {
  // What the format allows and we never write: INT16 of all cells, in a frame or not.
  v1::Grid proto = Encoded(SmallGrid(), CellEncoding::kRaw);
  proto.mutable_layers()->RemoveLast();
  v1::GridLayer* layer = proto.mutable_layers(0);
  layer->set_type(v1::PointField::TYPE_INT16);
  layer->set_scale(0.5);
  layer->set_offset(10);
  const std::array<std::int16_t, 6> cells = {-1, 0, 1, 2, 99, -20};
  const std::string data(reinterpret_cast<const char*>(cells.data()), sizeof(cells));
  layer->set_data(data);
  auto back = Decode(proto);
  ASSERT_TRUE(back.ok()) << back.status();
  const std::vector<float> want = {9.5f, 10, 10.5f, 11, 0, 0};
  EXPECT_EQ(back->layers[0].values, want);
  layer->set_zstd(true);
  layer->set_data(Compressed(data, 1));
  layer->set_valid_bitmap(Compressed(layer->valid_bitmap(), 1));
  back = Decode(proto);
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ(back->layers[0].values, want);
}

TEST(Grid, RefusesPredictorsThatDoNotFit) {
  v1::Grid proto = Encoded(SmallGrid(), CellEncoding::kRaw);
  proto.mutable_layers(0)->set_predictor(v1::GridLayer::PREDICTOR_MEDIAN);
  EXPECT_THAT(Decode(proto),
              Refused("grid.layers[0].predictor",
                      "grid.layers[0].predictor is PREDICTOR_MEDIAN, want PREDICTOR_UNSPECIFIED "
                      "for TYPE_FLOAT32"));
  proto.mutable_layers(0)->set_predictor(static_cast<v1::GridLayer::Predictor>(7));
  EXPECT_THAT(Decode(proto), Refused("grid.layers[0].predictor",
                                     "grid.layers[0].predictor is 7, want PREDICTOR_UNSPECIFIED or "
                                     "PREDICTOR_MEDIAN"));
}

TEST(Grid, RefusesDataThatDoesNotFitTheValidCells) {
  v1::Grid proto = Encoded(SmallGrid(), CellEncoding::kCompact);
  // Five of six cells are valid: ten bytes of INT16.
  proto.mutable_layers(0)->set_data(Compressed(std::string(12, '\0'), 1));
  EXPECT_THAT(Decode(proto), Refused("grid.layers[0].data",
                                     "grid.layers[0].data is a zstd frame of 12 bytes, want 10"));
}

TEST(Grid, RefusesAStampThatCannotBe) {
  v1::Grid proto = Encoded(SmallGrid(), CellEncoding::kRaw);
  proto.set_stamp_ns(-1);
  EXPECT_EQ(FieldOf(Decode(proto).status()), "grid.stamp_ns");
}

TEST(Grid, CompactOfNoKnownCellIsFine) {
  LayeredGrid grid{2, 1, 0.2, {}};
  grid.layers.push_back({Layer::kElevation, {0, 0}, {0, 0}, {}});
  const auto back = Decode(Encoded(grid, CellEncoding::kCompact));
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ(back->layers, grid.layers);
}

TEST(Grid, RefusesSizesBeforeAllocating) {
  v1::Grid proto = Encoded(SmallGrid(), CellEncoding::kRaw);
  proto.set_columns(1025);
  EXPECT_THAT(Decode(proto), Refused("grid.columns", "grid.columns is 1025, want 1 to 1024"));
  proto.set_columns(0xffffffff);
  EXPECT_EQ(FieldOf(Decode(proto).status()), "grid.columns");
  proto.set_columns(3);
  proto.set_rows(0);
  EXPECT_THAT(Decode(proto), Refused("grid.rows", "grid.rows is 0, want 1 to 1024"));
  proto.set_rows(2);
  proto.set_cell_size_m(0);
  EXPECT_EQ(FieldOf(Decode(proto).status()), "grid.cell_size_m");
}

TEST(Grid, RefusesLayersThatDoNotFitTheCells) {
  v1::Grid proto = Encoded(SmallGrid(), CellEncoding::kRaw);
  proto.mutable_layers(0)->mutable_data()->pop_back();
  EXPECT_THAT(Decode(proto),
              Refused("grid.layers[0].data", "grid.layers[0].data is 23 bytes, want 24"));
  proto = Encoded(SmallGrid(), CellEncoding::kRaw);
  proto.mutable_layers(0)->set_valid_bitmap("");
  EXPECT_THAT(Decode(proto), Refused("grid.layers[0].valid_bitmap",
                                     "grid.layers[0].valid_bitmap is 0 bytes, want 1"));
  proto = Encoded(SmallGrid(), CellEncoding::kRaw);
  proto.mutable_layers(1)->set_layer(v1::LAYER_ELEVATION);
  EXPECT_EQ(FieldOf(Decode(proto).status()), "grid.layers[1].type");
  proto = Encoded(SmallGrid(), CellEncoding::kRaw);
  *proto.mutable_layers(1) = proto.layers(0);
  EXPECT_THAT(Decode(proto), Refused("grid.layers[1].layer",
                                     "grid.layers[1].layer is LAYER_ELEVATION for the second time, "
                                     "want each layer at most once"));
  proto = Encoded(SmallGrid(), CellEncoding::kRaw);
  proto.mutable_layers(0)->set_layer(static_cast<v1::Layer>(9));
  EXPECT_THAT(Decode(proto),
              Refused("grid.layers[0].layer", "grid.layers[0].layer is 9, want a known layer"));
  proto = Encoded(SmallGrid(), CellEncoding::kCompact);
  proto.mutable_layers(0)->set_scale(std::numeric_limits<double>::quiet_NaN());
  EXPECT_EQ(FieldOf(Decode(proto).status()), "grid.layers[0].scale");
}

TEST(Grid, RefusesAFrameThatClaimsAnotherSize) {
  v1::Grid proto = Encoded(SmallGrid(), CellEncoding::kCompact);
  // A frame of a few bytes that would inflate to 100 MB.
  const std::string zeros(100'000'000, '\0');
  std::string bomb(ZSTD_compressBound(zeros.size()), '\0');
  bomb.resize(ZSTD_compress(bomb.data(), bomb.size(), zeros.data(), zeros.size(), 1));
  proto.mutable_layers(0)->set_data(bomb);
  EXPECT_THAT(Decode(proto),
              Refused("grid.layers[0].data",
                      "grid.layers[0].data is a zstd frame of 100000000 bytes, want 10"));
  proto.mutable_layers(0)->set_data("not a frame");
  EXPECT_THAT(Decode(proto),
              Refused("grid.layers[0].data",
                      "grid.layers[0].data is not a zstd frame, want one zstd frame"));
}

TEST(Grid, RefusesADamagedFrameAndWhatFollowsAFrame) {
  v1::Grid proto = Encoded(SmallGrid(), CellEncoding::kCompact);
  std::string* data = proto.mutable_layers(0)->mutable_data();
  const std::string intact = *data;
  data->resize(data->size() - 1);
  EXPECT_EQ(FieldOf(Decode(proto).status()), "grid.layers[0].data");
  *data = intact + Compressed("", 1);
  EXPECT_EQ(FieldOf(Decode(proto).status()), "grid.layers[0].data");
  *data = intact + "x";
  EXPECT_THAT(Decode(proto),
              Refused("grid.layers[0].data",
                      "grid.layers[0].data is 1 bytes behind a zstd frame, want one zstd frame"));
}

TEST(Grid, RefusesValuesThatAreNotFiniteWhereTheyAreValid) {
  LayeredGrid grid = SmallGrid();
  grid.layers[0].values[2] = std::numeric_limits<float>::quiet_NaN();
  EXPECT_THAT(
      Decode(Encoded(grid, CellEncoding::kRaw)),
      Refused("grid.layers[0].data[2]", "grid.layers[0].data[2] is nan, want a finite number"));
}

TEST(Layers, NoneMeansElevation) {
  const auto layers = LayersFromProto({}, {Layer::kElevation, Layer::kAge}, FieldPath("layers"));
  ASSERT_TRUE(layers.ok());
  EXPECT_EQ(*layers, std::vector<Layer>{Layer::kElevation});
}

TEST(Layers, RefusesRepeatsAndWhatIsNotServed) {
  const std::vector<Layer> served = {Layer::kElevation, Layer::kAge};
  const FieldPath field("layers");
  EXPECT_THAT(
      LayersFromProto({1, 1}, served, field),
      Refused("layers[1]",
              "layers[1] is LAYER_ELEVATION for the second time, want each layer at most once"));
  EXPECT_THAT(
      LayersFromProto({4}, served, field),
      Refused("layers[0]", "layers[0] is LAYER_SLOPE, want one of LAYER_ELEVATION LAYER_AGE"));
  EXPECT_EQ(FieldOf(LayersFromProto({0}, served, field).status()), "layers[0]");
  EXPECT_EQ(FieldOf(EncodingFromProto(3, FieldPath("encoding")).status()), "encoding");
}

TEST(Encoding, UnspecifiedMeansCompact) {
  EXPECT_EQ(*EncodingFromProto(0, FieldPath("encoding")), CellEncoding::kCompact);
  EXPECT_EQ(*EncodingFromProto(1, FieldPath("encoding")), CellEncoding::kRaw);
  EXPECT_EQ(*EncodingFromProto(2, FieldPath("encoding")), CellEncoding::kCompact);
}

}  // namespace
}  // namespace gem::wire
