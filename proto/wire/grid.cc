#include "proto/wire/grid.h"

#include <zstd.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include "absl/strings/str_cat.h"
#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "gem/v1/types.pb.h"
#include "proto/wire/refusal.h"
#include "proto/wire/scalar.h"

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

std::string Compressed(const std::string& data) {
  std::string frame(ZSTD_compressBound(data.size()), '\0');
  const std::size_t size =
      ZSTD_compress(frame.data(), frame.size(), data.data(), data.size(), kZstdLevel);
  GEM_CHECK(!ZSTD_isError(size));
  frame.resize(size);
  return frame;
}

/// The frame's own header claims the size: it must be exactly what the cells need, before a byte is
/// allocated.
absl::StatusOr<std::string> Inflated(const std::string& frame, std::size_t size_bytes,
                                     const FieldPath& field) {
  const unsigned long long claimed = ZSTD_getFrameContentSize(frame.data(), frame.size());
  if (claimed == ZSTD_CONTENTSIZE_ERROR) return Refuse(field, "not a zstd frame", "one zstd frame");
  if (claimed == ZSTD_CONTENTSIZE_UNKNOWN)
    return Refuse(field, "a zstd frame without content size", "the size in the frame's header");
  if (claimed != size_bytes)
    return Refuse(field, absl::StrCat("a zstd frame of ", claimed, " bytes"),
                  absl::StrCat(size_bytes));
  std::string data(size_bytes, '\0');
  const std::size_t size = ZSTD_decompress(data.data(), data.size(), frame.data(), frame.size());
  if (ZSTD_isError(size)) return Refuse(field, ZSTD_getErrorName(size), "one intact zstd frame");
  if (size != size_bytes)
    return Refuse(field, absl::StrCat(size, " bytes"), absl::StrCat(size_bytes));
  return data;
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
  const double scale = std::max(StepOf(layer.layer), (high - low) / (2 * (kRawMax - 1)));
  // A multiple of the step: equal heights of neighbouring tiles stay equal.
  return {scale, std::round((low + high) / 2 / scale) * scale};
}

std::string Quantised(const GridLayer& layer, const Quantisation& quantisation) {
  std::string data(layer.values.size() * sizeof(std::int16_t), '\0');
  // Rounded down: never freer than it is.
  const bool down = layer.layer == Layer::kTraversability;
  for (std::size_t i = 0; i < layer.values.size(); ++i) {
    if (!layer.valid[i]) continue;
    const double steps =
        (static_cast<double>(layer.values[i]) - quantisation.offset) / quantisation.scale;
    const double rounded = down ? std::floor(steps) : std::nearbyint(steps);
    const auto raw = static_cast<std::int16_t>(std::clamp(rounded, -kRawMax, kRawMax));
    std::memcpy(data.data() + i * sizeof(raw), &raw, sizeof(raw));
  }
  return data;
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

void LayerToProto(const GridLayer& layer, CellEncoding encoding, v1::GridLayer* proto) {
  proto->set_layer(static_cast<v1::Layer>(ToProto(layer.layer)));
  const bool compact = encoding == CellEncoding::kCompact;
  std::string data;
  if (layer.layer == Layer::kColor) {
    proto->set_type(v1::PointField::TYPE_UINT32);
    data = BytesOf(layer.colors);
  } else if (compact) {
    const Quantisation quantisation = QuantisationOf(layer);
    proto->set_type(v1::PointField::TYPE_INT16);
    proto->set_scale(quantisation.scale);
    proto->set_offset(quantisation.offset);
    data = Quantised(layer, quantisation);
  } else {
    proto->set_type(v1::PointField::TYPE_FLOAT32);
    data = BytesOf(layer.values);
  }
  const std::string bitmap = BitmapOf(layer.valid);
  proto->set_zstd(compact);
  proto->set_valid_bitmap(compact ? Compressed(bitmap) : bitmap);
  proto->set_data(compact ? Compressed(data) : std::move(data));
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

absl::Status DecodeValues(const v1::GridLayer& proto, const std::string& data,
                          const FieldPath& field, GridLayer& layer) {
  const std::size_t num_cells = layer.valid.size();
  const bool int16 = proto.type() == v1::PointField::TYPE_INT16;
  layer.values.resize(num_cells);
  for (std::size_t i = 0; i < num_cells; ++i) {
    if (!layer.valid[i]) continue;
    float value = 0;
    if (int16) {
      std::int16_t raw = 0;
      std::memcpy(&raw, data.data() + i * sizeof(raw), sizeof(raw));
      value = static_cast<float>(raw * proto.scale() + proto.offset());
    } else {
      std::memcpy(&value, data.data() + i * sizeof(value), sizeof(value));
    }
    const FieldPath cells = field.Child("data");
    GEM_RETURN_IF_ERROR(CheckFinite(value, cells.At(i)));
    layer.values[i] = value;
  }
  return absl::OkStatus();
}

absl::StatusOr<GridLayer> LayerFromProto(const v1::GridLayer& proto, std::size_t num_cells,
                                         const FieldPath& field) {
  const int number = static_cast<int>(proto.layer());
  if (number < 1 || number > static_cast<int>(kLayerNames.size()))
    return Refuse(field.Child("layer"), LayerName(number), "a known layer");
  GridLayer layer{static_cast<Layer>(number - 1), {}, {}, {}};
  GEM_ASSIGN_OR_RETURN(const std::size_t cell_bytes, CellBytes(proto, layer.layer, field));
  GEM_ASSIGN_OR_RETURN(
      const std::string bitmap,
      Bytes(proto.valid_bitmap(), proto.zstd(), (num_cells + 7) / 8, field.Child("valid_bitmap")));
  GEM_ASSIGN_OR_RETURN(const std::string data, Bytes(proto.data(), proto.zstd(),
                                                     num_cells * cell_bytes, field.Child("data")));
  layer.valid.resize(num_cells);
  for (std::size_t i = 0; i < num_cells; ++i)
    layer.valid[i] = static_cast<std::uint8_t>((bitmap[i / 8] >> (i % 8)) & 1);
  if (layer.layer == Layer::kColor) {
    layer.colors.resize(num_cells);
    std::memcpy(layer.colors.data(), data.data(), data.size());
    for (std::size_t i = 0; i < num_cells; ++i)
      if (!layer.valid[i]) layer.colors[i] = 0;
    return layer;
  }
  GEM_RETURN_IF_ERROR(DecodeValues(proto, data, field, layer));
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
  if (encoding == v1::CELL_ENCODING_UNSPECIFIED || encoding == v1::CELL_ENCODING_RAW)
    return CellEncoding::kRaw;
  if (encoding == v1::CELL_ENCODING_COMPACT) return CellEncoding::kCompact;
  return Refuse(field, absl::StrCat(encoding), "CELL_ENCODING_RAW or CELL_ENCODING_COMPACT");
}

void ToProto(const LayeredGrid& grid, CellEncoding encoding, v1::Grid* proto) {
  proto->set_columns(static_cast<std::uint32_t>(grid.columns));
  proto->set_rows(static_cast<std::uint32_t>(grid.rows));
  proto->set_cell_size_m(grid.cell_size_m);
  proto->clear_layers();
  for (const GridLayer& layer : grid.layers) LayerToProto(layer, encoding, proto->add_layers());
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
  LayeredGrid grid{static_cast<std::int32_t>(proto.columns()),
                   static_cast<std::int32_t>(proto.rows()),
                   proto.cell_size_m(),
                   {}};
  const FieldPath layers = field.Child("layers");
  for (int i = 0; i < proto.layers_size(); ++i) {
    const FieldPath element = layers.At(static_cast<std::size_t>(i));
    absl::StatusOr<GridLayer> layer = LayerFromProto(proto.layers(i), grid.num_cells(), element);
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
