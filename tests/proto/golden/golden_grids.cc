#include <cmath>
#include <limits>
#include <random>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "core/base/check.h"
#include "gem/v1/types.pb.h"
#include "proto/wire/cell_codec.h"
#include "proto/wire/grid.h"
#include "proto/wire/zstd_frame.h"
#include "tests/proto/golden/golden_cases.h"
#include "tests/proto/golden/golden_file.h"

namespace gem::golden {
namespace {

constexpr float kUnknown = std::numeric_limits<float>::quiet_NaN();

GridLayer Values(Layer layer, const std::vector<float>& values) {
  GridLayer result{layer, {}, {}, {}};
  for (const float value : values) {
    result.valid.push_back(!std::isnan(value));
    result.values.push_back(std::isnan(value) ? 0 : value);
  }
  return result;
}

GridLayer Colors(const std::vector<Rgba>& colors) {
  GridLayer result{Layer::kColor, {}, {}, colors};
  for (const Rgba color : colors) result.valid.push_back(color != 0);
  return result;
}

LayeredGrid GridOf(std::int32_t columns, std::int32_t rows, std::vector<GridLayer> layers) {
  return {columns, rows, 0.2, std::move(layers), 1'700'000'000'000'000'000};
}

/// What the frames of an encoded layer hold, and what its cells are.
LayerCase Opened(const v1::GridLayer& proto, const GridLayer& decoded) {
  const std::size_t bitmap_bytes = (decoded.valid.size() + 7) / 8;
  const wire::CellMask mask{decoded.valid, 1};
  const std::size_t width = proto.type() == v1::PointField::TYPE_INT16 ? 2 : 4;
  const std::size_t data_bytes =
      width * (proto.predictor() == v1::GridLayer::PREDICTOR_MEDIAN ? mask.num_valid()
                                                                    : decoded.valid.size());
  LayerCase result;
  const auto hex = [&](const std::string& bytes, std::size_t size) {
    return Hex(proto.zstd() ? *wire::Inflated(bytes, size, wire::FieldPath("frame")) : bytes);
  };
  result.set_valid_bitmap_hex(hex(proto.valid_bitmap(), bitmap_bytes));
  result.set_data_hex(hex(proto.data(), data_bytes));
  *result.mutable_values() = ListOf(decoded);
  return result;
}

/// As the server encodes it, if `input` is given; else `proto` is something that decoders take.
void Add(const std::string& name, const std::string& shows, const v1::Grid& proto,
         const LayeredGrid* input, Grids* grids) {
  GridCase& result = *grids->add_cases();
  result.set_name(name);
  result.set_shows(shows);
  *result.mutable_grid() = proto;
  const auto decoded = wire::FromProto(proto, wire::kGridCells_max, wire::FieldPath("grid"));
  GEM_CHECK(decoded.ok());
  for (int i = 0; i < proto.layers_size(); ++i) {
    LayerCase& layer = *result.add_layers();
    layer = Opened(proto.layers(i), decoded->layers[static_cast<std::size_t>(i)]);
    if (input != nullptr)
      *layer.mutable_input() = ListOf(input->layers[static_cast<std::size_t>(i)]);
  }
}

void AddEncoded(const std::string& name, const std::string& shows, wire::CellEncoding encoding,
                const LayeredGrid& input, Grids* grids) {
  v1::Grid proto;
  wire::ToProto(input, encoding, &proto);
  Add(name, shows, proto, &input, grids);
}

std::string BytesOf(const void* data, std::size_t size) {
  return {static_cast<const char*>(data), size};
}

v1::Grid OneLayer(std::uint32_t columns, std::uint32_t rows, v1::PointField::Type type) {
  v1::Grid proto;
  proto.set_columns(columns);
  proto.set_rows(rows);
  proto.set_cell_size_m(0.1);
  v1::GridLayer& layer = *proto.add_layers();
  layer.set_layer(v1::LAYER_ELEVATION);
  layer.set_type(type);
  return proto;
}

void AddRaw(Grids* grids) {
  const auto raw = wire::CellEncoding::kRaw;
  AddEncoded("raw", "float32 by rows from the lower left, a bit a cell; unknown cells have bytes",
             raw,
             GridOf(4, 3,
                    {Values(Layer::kElevation, {1.5f, -2.25f, 0, kUnknown,        //
                                                0.1f, kUnknown, kUnknown, 1e-3f,  //
                                                100, 3.1415927f, -0.001f, 0.2f})}),
             grids);
  AddEncoded("raw_color", "red is the lowest byte; more than one layer", raw,
             GridOf(3, 1,
                    {Colors({0xff0000ff, 0, 0xff030201}),
                     Values(Layer::kTraversability, {1, 0, kUnknown})}),
             grids);
  AddEncoded("raw_unknown", "no cell has a value", raw,
             GridOf(3, 3, {Values(Layer::kElevation, std::vector<float>(9, kUnknown))}), grids);
}

void AddCompact(Grids* grids) {
  const auto compact = wire::CellEncoding::kCompact;
  AddEncoded(
      "compact_slope", "the whole way: offset, median predictor, zigzag, planes, frames", compact,
      GridOf(5, 4, {Values(Layer::kElevation, {-0.3f,    -0.2f,  -0.1004f, 0,        0.1f,      //
                                               -0.25f,   -0.15f, kUnknown, 0.05f,    0.15f,     //
                                               -0.2f,    -0.1f,  0,        kUnknown, kUnknown,  //
                                               kUnknown, 1.2f,   1.2006f,  kUnknown, 0.25f})}),
      grids);
  AddEncoded("compact_unknown", "no cell has a value: frames of a bitmap and of no bytes", compact,
             GridOf(9, 2, {Values(Layer::kElevation, std::vector<float>(18, kUnknown))}), grids);
  AddEncoded("compact_one_cell", "the offset is the only value", compact,
             GridOf(1, 1, {Values(Layer::kElevation, {-12.3456f})}), grids);
  AddEncoded("compact_far_up", "float32 is coarser than a millimetre there", compact,
             GridOf(2, 2, {Values(Layer::kElevation, {24321.5f, 24321.75f, 24322, kUnknown})}),
             grids);
  AddEncoded("compact_wide_span", "more than 65,532 steps of 1 mm: scale is 4 mm", compact,
             GridOf(3, 1, {Values(Layer::kElevation, {-100, 0.0061f, 100})}), grids);
  AddEncoded("compact_rounding", "each layer has its step and its direction of rounding", compact,
             GridOf(2, 2,
                    {Values(Layer::kElevation, {0.0104f, 0.0106f, -0.0104f, -0.0106f}),
                     Values(Layer::kVariance, {1.01e-4f, 1.001e-4f, 0.25f, kUnknown}),
                     Values(Layer::kTraversability, {0.70019f, 0.99999f, 1, 0}),
                     Values(Layer::kSlope, {0.12344f, 0.12346f, 0, kUnknown}),
                     Values(Layer::kRoughness, {0.01004f, 0.01006f, 0, kUnknown}),
                     Values(Layer::kAge, {0, 0.014f, 12.346f, kUnknown})}),
             grids);
  AddEncoded("compact_color", "four channels, each predicted for itself", compact,
             GridOf(3, 2,
                    {Colors({0xff102030, 0xff112131, 0xffff0000,  //
                             0xff102030, 0, 0xff00ffff})}),
             grids);
}

/// Every line of the table of predictions, and differences that wrap round.
void AddPredictions(Grids* grids) {
  std::mt19937 random(7);
  std::vector<std::uint8_t> valid(8 * 8);
  std::vector<std::int16_t> cells(valid.size());
  v1::Grid proto = OneLayer(8, 8, v1::PointField::TYPE_INT16);
  v1::GridLayer& layer = *proto.mutable_layers(0);
  layer.set_scale(0.5);
  layer.set_offset(-3);
  layer.set_predictor(v1::GridLayer::PREDICTOR_MEDIAN);
  std::string bitmap(8, '\0');
  for (std::size_t i = 0; i < valid.size(); ++i) {
    valid[i] = random() % 100 < 50;
    if (valid[i] == 0) continue;
    bitmap[i / 8] = static_cast<char>(bitmap[i / 8] | 1 << (i % 8));
    cells[i] = static_cast<std::int16_t>(random());
  }
  layer.set_valid_bitmap(bitmap);
  layer.set_data(wire::EncodeCells(std::span<const std::int16_t>(cells), {valid, 8}));
  Add("predictions", "any mask, any values: every line of the table; differences wrap round", proto,
      nullptr, grids);
}

/// What the server does not send, but decoders take.
void AddOtherCombinations(Grids* grids) {
  v1::Grid proto = OneLayer(3, 1, v1::PointField::TYPE_INT16);
  v1::GridLayer& layer = *proto.mutable_layers(0);
  layer.set_scale(0.25);
  layer.set_offset(10);
  const std::vector<std::int16_t> cells = {4, 1234, -4};
  layer.set_valid_bitmap("\x05");
  layer.set_data(BytesOf(cells.data(), 6));
  Add("int16_plain", "without predictor and frame: the middle cell's bytes mean nothing", proto,
      nullptr, grids);
  layer.set_zstd(true);
  layer.set_valid_bitmap(wire::Compressed(layer.valid_bitmap(), 1));
  layer.set_data(wire::Compressed(layer.data(), 1));
  Add("int16_frame", "a frame without predictor", proto, nullptr, grids);

  proto = OneLayer(2, 1, v1::PointField::TYPE_FLOAT32);
  v1::GridLayer& floats = *proto.mutable_layers(0);
  const std::vector<float> values = {kUnknown, 1.25f};
  floats.set_zstd(true);
  floats.set_valid_bitmap(wire::Compressed("\xfe", 1));
  floats.set_data(wire::Compressed(BytesOf(values.data(), 8), 1));
  Add("float32_frame",
      "NaN where no cell is valid, and bits behind the last cell: both mean nothing", proto,
      nullptr, grids);
}

}  // namespace

Grids MakeGrids() {
  Grids grids;
  AddRaw(&grids);
  AddCompact(&grids);
  AddPredictions(&grids);
  AddOtherCombinations(&grids);
  return grids;
}

}  // namespace gem::golden
