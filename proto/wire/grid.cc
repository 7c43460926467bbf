#include "proto/wire/grid.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <span>

#include "absl/strings/str_cat.h"
#include "core/base/status_macros.h"
#include "gem/v1/types.pb.h"
#include "proto/wire/cell_codec.h"
#include "proto/wire/refusal.h"
#include "proto/wire/scalar.h"
#include "proto/wire/zstd_frame.h"

namespace gem::wire {
namespace {

constexpr int kZstdLevel = 1;
/// Raw values lie in [-kRawMax, kRawMax] around the offset.
constexpr double kRawMax = 32767;

/// How finely a layer is worth storing.
double StepOf(Layer layer) {
  switch (layer) {
    case Layer::kElevation:
      return 1e-3;
    case Layer::kVariance:
      return 1e-6;
    case Layer::kAge:
      return 1e-2;
    default:
      return 1e-4;
  }
}

/// value = raw * scale + offset for the valid cells of one layer.
struct Quantisation {
  double scale = 1;
  double offset = 0;
};

Quantisation QuantisationOf(const GridLayer& layer) {
  double low = std::numeric_limits<double>::infinity();
  double high = -low;
  for (std::size_t i = 0; i < layer.values.size(); ++i) {
    if (!layer.valid[i]) continue;
    low = std::min(low, static_cast<double>(layer.values[i]));
    high = std::max(high, static_cast<double>(layer.values[i]));
  }
  if (low > high) return {StepOf(layer.layer), 0};
  // Scale and offset are multiples of the step: equal heights of neighbouring tiles stay equal.
  const double step = StepOf(layer.layer);
  const double scale = step * std::max(1.0, std::ceil((high - low) / (2 * (kRawMax - 1)) / step));
  return {scale, std::round((low + high) / 2 / scale) * scale};
}

/// Rounds so that nobody is promised too much: traversability down, never freer than it is, and
/// variance up, never surer.
double Rounded(Layer layer, double steps) {
  if (layer == Layer::kTraversability) return std::floor(steps);
  if (layer == Layer::kVariance) return std::ceil(steps);
  return std::nearbyint(steps);
}

std::vector<std::int16_t> Quantised(const GridLayer& layer, const Quantisation& quantisation) {
  std::vector<std::int16_t> raw(layer.values.size());
  for (std::size_t i = 0; i < raw.size(); ++i) {
    if (!layer.valid[i]) continue;
    const double steps =
        (static_cast<double>(layer.values[i]) - quantisation.offset) / quantisation.scale;
    raw[i] = static_cast<std::int16_t>(std::clamp(Rounded(layer.layer, steps), -kRawMax, kRawMax));
  }
  return raw;
}

template <typename T>
std::string BytesOf(const std::vector<T>& values) {
  return {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T)};
}

std::string BitmapOf(const std::vector<std::uint8_t>& valid) {
  std::string bitmap((valid.size() + 7) / 8, '\0');
  for (std::size_t i = 0; i < valid.size(); ++i)
    if (valid[i]) bitmap[i / 8] = static_cast<char>(bitmap[i / 8] | (1 << (i % 8)));
  return bitmap;
}

void RawToProto(const GridLayer& layer, v1::GridLayer* proto) {
  const bool is_color = layer.layer == Layer::kColor;
  proto->set_type(is_color ? v1::PointField::TYPE_UINT32 : v1::PointField::TYPE_FLOAT32);
  proto->set_valid_bitmap(BitmapOf(layer.valid));
  proto->set_data(is_color ? BytesOf(layer.colors) : BytesOf(layer.values));
}

void CompactToProto(const GridLayer& layer, std::size_t columns, v1::GridLayer* proto) {
  const CellMask mask{layer.valid, columns};
  std::string data;
  if (layer.layer == Layer::kColor) {
    proto->set_type(v1::PointField::TYPE_UINT32);
    data = EncodeCells(std::span<const Rgba>(layer.colors), mask);
  } else {
    const Quantisation quantisation = QuantisationOf(layer);
    proto->set_type(v1::PointField::TYPE_INT16);
    proto->set_scale(quantisation.scale);
    proto->set_offset(quantisation.offset);
    data = EncodeCells(std::span<const std::int16_t>(Quantised(layer, quantisation)), mask);
  }
  proto->set_predictor(v1::GridLayer::PREDICTOR_MEDIAN);
  proto->set_zstd(true);
  proto->set_valid_bitmap(Compressed(BitmapOf(layer.valid), kZstdLevel));
  proto->set_data(Compressed(data, kZstdLevel));
}

std::string LayerName(int layer) {
  const std::string& name = v1::Layer_Name(static_cast<v1::Layer>(layer));
  return name.empty() ? absl::StrCat(layer) : name;
}

/// Bytes of one cell of a layer, after its type was checked.
absl::StatusOr<std::size_t> CellBytes(const v1::GridLayer& proto, Layer layer,
                                      const FieldPath& field) {
  const std::string& type = v1::PointField::Type_Name(proto.type());
  if (layer == Layer::kColor) {
    if (proto.type() == v1::PointField::TYPE_UINT32) return sizeof(Rgba);
    return Refuse(field.Child("type"), type, "TYPE_UINT32 for colour");
  }
  if (proto.type() == v1::PointField::TYPE_FLOAT32) return sizeof(float);
  if (proto.type() != v1::PointField::TYPE_INT16)
    return Refuse(field.Child("type"), type, "TYPE_FLOAT32 or TYPE_INT16");
  if (!std::isfinite(proto.scale()) || proto.scale() <= 0)
    return Refuse(field.Child("scale"), proto.scale(), "a finite number above 0");
  GEM_RETURN_IF_ERROR(CheckFinite(proto.offset(), field.Child("offset")));
  return sizeof(std::int16_t);
}

absl::StatusOr<std::string> Bytes(const std::string& data, bool zstd, std::size_t size_bytes,
                                  const FieldPath& field) {
  if (zstd) return Inflated(data, size_bytes, field);
  if (data.size() != size_bytes)
    return Refuse(field, absl::StrCat(data.size(), " bytes"), absl::StrCat(size_bytes));
  return data;
}

/// How many of the cells have bytes in `data`: with a predictor only those that are valid.
absl::StatusOr<std::size_t> NumStored(const v1::GridLayer& proto, const CellMask& mask,
                                      const FieldPath& field) {
  const FieldPath predictor = field.Child("predictor");
  if (proto.predictor() == v1::GridLayer::PREDICTOR_UNSPECIFIED) return mask.valid.size();
  if (proto.predictor() != v1::GridLayer::PREDICTOR_MEDIAN)
    return Refuse(predictor, absl::StrCat(static_cast<int>(proto.predictor())),
                  "PREDICTOR_UNSPECIFIED or PREDICTOR_MEDIAN");
  if (proto.type() == v1::PointField::TYPE_FLOAT32)
    return Refuse(predictor, "PREDICTOR_MEDIAN", "PREDICTOR_UNSPECIFIED for TYPE_FLOAT32");
  return mask.num_valid();
}

/// The cells of a type, whatever was done to them. data has the right size.
template <typename T, typename Undo>
std::vector<T> CellsOf(const v1::GridLayer& proto, const std::string& data, const CellMask& mask,
                       Undo undo) {
  if (proto.predictor() == v1::GridLayer::PREDICTOR_MEDIAN) return undo(data, mask);
  std::vector<T> cells(mask.valid.size());
  std::memcpy(cells.data(), data.data(), data.size());
  return cells;
}

absl::Status DecodeValues(const v1::GridLayer& proto, const std::string& data, const CellMask& mask,
                          const FieldPath& field, std::vector<float>& values) {
  values.resize(mask.valid.size());
  if (proto.type() == v1::PointField::TYPE_INT16) {
    const auto raw = CellsOf<std::int16_t>(proto, data, mask, DecodeCells);
    for (std::size_t i = 0; i < raw.size(); ++i)
      values[i] = static_cast<float>(raw[i] * proto.scale() + proto.offset());
  } else {
    std::memcpy(values.data(), data.data(), data.size());
  }
  const FieldPath cells = field.Child("data");
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (!mask.valid[i]) values[i] = 0;
    GEM_RETURN_IF_ERROR(CheckFinite(values[i], cells.At(i)));
  }
  return absl::OkStatus();
}

absl::StatusOr<std::vector<std::uint8_t>> ValidFromProto(const v1::GridLayer& proto,
                                                         std::size_t num_cells,
                                                         const FieldPath& field) {
  GEM_ASSIGN_OR_RETURN(
      const std::string bitmap,
      Bytes(proto.valid_bitmap(), proto.zstd(), (num_cells + 7) / 8, field.Child("valid_bitmap")));
  std::vector<std::uint8_t> valid(num_cells);
  for (std::size_t i = 0; i < num_cells; ++i)
    valid[i] = static_cast<std::uint8_t>((bitmap[i / 8] >> (i % 8)) & 1);
  return valid;
}

absl::StatusOr<GridLayer> LayerFromProto(const v1::GridLayer& proto, std::size_t num_cells,
                                         std::size_t columns, const FieldPath& field) {
  const int number = static_cast<int>(proto.layer());
  if (number < 1 || number > static_cast<int>(kLayerNames.size()))
    return Refuse(field.Child("layer"), LayerName(number), "a known layer");
  GridLayer layer{static_cast<Layer>(number - 1), {}, {}, {}};
  GEM_ASSIGN_OR_RETURN(const std::size_t cell_bytes, CellBytes(proto, layer.layer, field));
  GEM_ASSIGN_OR_RETURN(layer.valid, ValidFromProto(proto, num_cells, field));
  const CellMask mask{layer.valid, columns};
  GEM_ASSIGN_OR_RETURN(const std::size_t num_stored, NumStored(proto, mask, field));
  GEM_ASSIGN_OR_RETURN(const std::string data, Bytes(proto.data(), proto.zstd(),
                                                     num_stored * cell_bytes, field.Child("data")));
  if (layer.layer != Layer::kColor) {
    GEM_RETURN_IF_ERROR(DecodeValues(proto, data, mask, field, layer.values));
    return layer;
  }
  layer.colors = CellsOf<Rgba>(proto, data, mask, DecodeColors);
  for (std::size_t i = 0; i < num_cells; ++i)
    if (!layer.valid[i]) layer.colors[i] = 0;
  return layer;
}

}  // namespace

int ToProto(Layer layer) { return static_cast<int>(layer) + 1; }
static_assert(static_cast<int>(Layer::kElevation) + 1 == v1::LAYER_ELEVATION);
static_assert(static_cast<int>(Layer::kAge) + 1 == v1::LAYER_AGE);
static_assert(static_cast<int>(CellEncoding::kCompact) == v1::CELL_ENCODING_COMPACT);

absl::StatusOr<std::vector<Layer>> LayersFromProto(const std::vector<int>& layers,
                                                   const std::vector<Layer>& served,
                                                   const FieldPath& field) {
  if (layers.empty()) return std::vector<Layer>{Layer::kElevation};
  // Unknown numbers and repeats are refused, so there are never more than there are layers.
  std::vector<Layer> result;
  for (std::size_t i = 0; i < layers.size(); ++i) {
    const auto layer = std::find_if(served.begin(), served.end(),
                                    [&](Layer s) { return ToProto(s) == layers[i]; });
    if (layer == served.end()) {
      std::string want = "one of";
      for (const Layer s : served) absl::StrAppend(&want, " ", LayerName(ToProto(s)));
      return Refuse(field.At(i), LayerName(layers[i]), want);
    }
    if (std::find(result.begin(), result.end(), *layer) != result.end())
      return Refuse(field.At(i), absl::StrCat(LayerName(layers[i]), " for the second time"),
                    "each layer at most once");
    result.push_back(*layer);
  }
  return result;
}

absl::StatusOr<CellEncoding> EncodingFromProto(int encoding, const FieldPath& field) {
  if (encoding == v1::CELL_ENCODING_RAW) return CellEncoding::kRaw;
  if (encoding == v1::CELL_ENCODING_UNSPECIFIED || encoding == v1::CELL_ENCODING_COMPACT)
    return CellEncoding::kCompact;
  return Refuse(field, absl::StrCat(encoding), "CELL_ENCODING_RAW or CELL_ENCODING_COMPACT");
}

void ToProto(const LayeredGrid& grid, CellEncoding encoding, v1::Grid* proto) {
  proto->set_columns(static_cast<std::uint32_t>(grid.columns));
  proto->set_rows(static_cast<std::uint32_t>(grid.rows));
  proto->set_cell_size_m(grid.cell_size_m);
  proto->set_stamp_ns(grid.stamp_ns);
  proto->clear_layers();
  for (const GridLayer& layer : grid.layers) {
    v1::GridLayer* layer_proto = proto->add_layers();
    layer_proto->set_layer(static_cast<v1::Layer>(ToProto(layer.layer)));
    if (encoding == CellEncoding::kCompact)
      CompactToProto(layer, static_cast<std::size_t>(grid.columns), layer_proto);
    else
      RawToProto(layer, layer_proto);
  }
}

absl::StatusOr<LayeredGrid> FromProto(const v1::Grid& proto, std::int32_t side_cells_max,
                                      const FieldPath& field) {
  const auto limit = static_cast<std::uint32_t>(side_cells_max);
  if (proto.columns() < 1 || proto.columns() > limit)
    return Refuse(field.Child("columns"), absl::StrCat(proto.columns()),
                  absl::StrCat("1 to ", limit));
  if (proto.rows() < 1 || proto.rows() > limit)
    return Refuse(field.Child("rows"), absl::StrCat(proto.rows()), absl::StrCat("1 to ", limit));
  if (!std::isfinite(proto.cell_size_m()) || proto.cell_size_m() <= 0)
    return Refuse(field.Child("cell_size_m"), proto.cell_size_m(), "a finite number above 0");
  GEM_RETURN_IF_ERROR(CheckStamp(proto.stamp_ns(), field.Child("stamp_ns")));
  LayeredGrid grid{static_cast<std::int32_t>(proto.columns()),
                   static_cast<std::int32_t>(proto.rows()),
                   proto.cell_size_m(),
                   {},
                   proto.stamp_ns()};
  const FieldPath layers = field.Child("layers");
  for (int i = 0; i < proto.layers_size(); ++i) {
    const FieldPath element = layers.At(static_cast<std::size_t>(i));
    absl::StatusOr<GridLayer> layer =
        LayerFromProto(proto.layers(i), grid.num_cells(), proto.columns(), element);
    if (!layer.ok()) return layer.status();
    if (grid.Find(layer->layer) != nullptr)
      return Refuse(element.Child("layer"),
                    absl::StrCat(LayerName(proto.layers(i).layer()), " for the second time"),
                    "each layer at most once");
    grid.layers.push_back(*std::move(layer));
  }
  return grid;
}

}  // namespace gem::wire
