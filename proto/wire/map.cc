#include "proto/wire/map.h"

#include <algorithm>
#include <cstdlib>

#include "absl/container/btree_set.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "core/base/status_macros.h"
#include "gem/v1/map_service.pb.h"
#include "gem/v1/tile_service.pb.h"
#include "gem/v1/types.pb.h"
#include "proto/wire/pose.h"
#include "proto/wire/refusal.h"
#include "proto/wire/scalar.h"

namespace gem::wire {
namespace {

constexpr std::int32_t kTileIndexMax = 1 << 23;
constexpr std::int32_t kLocalOriginMax = 1 << 30;

std::uint8_t StateBitOf(Layer layer) {
  switch (layer) {
    case Layer::kTraversability:
    case Layer::kSlope:
    case Layer::kRoughness:
      return kCellAnnotated;
    case Layer::kColor:
      return kCellColored;
    case Layer::kElevation:
    case Layer::kVariance:
    case Layer::kAge:
      break;
  }
  return kCellKnown;
}

float AgeSeconds(std::int64_t newest_ns, std::int64_t observed_ns) {
  return static_cast<float>(static_cast<double>(newest_ns - observed_ns) * 1e-9);
}

/// 0 if no cell is known.
std::int64_t NewestStamp(const std::vector<CellBelief>& cells) {
  std::int64_t newest_ns = 0;
  for (const CellBelief& cell : cells)
    if (cell.known()) newest_ns = std::max(newest_ns, cell.stamp_ns);
  return newest_ns;
}

/// Fills a layer from value(i) and state(i).
template <typename State, typename Value>
GridLayer MakeLayer(Layer layer, std::size_t num_cells, State state, Value value) {
  GridLayer result{layer, std::vector<std::uint8_t>(num_cells), {}, {}};
  const std::uint8_t bit = StateBitOf(layer);
  result.values.resize(num_cells);
  for (std::size_t i = 0; i < num_cells; ++i) {
    if ((state(i) & bit) == 0) continue;
    result.valid[i] = 1;
    result.values[i] = value(i);
  }
  return result;
}

template <typename State, typename Color>
GridLayer MakeColorLayer(std::size_t num_cells, State state, Color color) {
  GridLayer result{Layer::kColor, std::vector<std::uint8_t>(num_cells), {}, {}};
  result.colors.resize(num_cells);
  for (std::size_t i = 0; i < num_cells; ++i) {
    if ((state(i) & kCellColored) == 0) continue;
    result.valid[i] = 1;
    result.colors[i] = color(i);
  }
  return result;
}

}  // namespace

const std::vector<Layer>& TileLayers() {
  static const std::vector<Layer> layers = {Layer::kElevation, Layer::kVariance,
                                            Layer::kTraversability, Layer::kColor, Layer::kAge};
  return layers;
}

const std::vector<Layer>& LocalMapLayers() {
  static const std::vector<Layer> layers = {
      Layer::kElevation, Layer::kVariance, Layer::kTraversability, Layer::kSlope, Layer::kRoughness,
      Layer::kColor,     Layer::kAge};
  return layers;
}

void ToProto(const MapVersion& version, v1::MapVersion* proto) {
  proto->set_epoch(version.epoch);
  proto->set_revision(version.revision);
}

MapVersion FromProto(const v1::MapVersion& proto) { return {proto.epoch(), proto.revision()}; }

void ToProto(const TileAddress& address, v1::TileKey* proto) {
  proto->set_level(static_cast<std::uint32_t>(address.level));
  proto->set_x(address.index.x);
  proto->set_y(address.index.y);
}

absl::StatusOr<int> LevelFromProto(std::uint32_t level, const FieldPath& field) {
  if (level <= static_cast<std::uint32_t>(kLevelMax)) return static_cast<int>(level);
  return Refuse(field, absl::StrCat(level), absl::StrCat("0 to ", kLevelMax));
}

absl::StatusOr<TileAddress> FromProto(const v1::TileKey& proto, const FieldPath& field) {
  GEM_ASSIGN_OR_RETURN(const int level, LevelFromProto(proto.level(), field.Child("level")));
  if (proto.x() < -kTileIndexMax || proto.x() > kTileIndexMax)
    return Refuse(field.Child("x"), absl::StrCat(proto.x()),
                  absl::StrCat("at most ", kTileIndexMax, " in magnitude"));
  if (proto.y() < -kTileIndexMax || proto.y() > kTileIndexMax)
    return Refuse(field.Child("y"), absl::StrCat(proto.y()),
                  absl::StrCat("at most ", kTileIndexMax, " in magnitude"));
  return TileAddress{level, {proto.x(), proto.y()}};
}

LayeredGrid GridOf(const Tile& tile, float cell_size_m, std::span<const Layer> layers) {
  const std::vector<CellBelief>& cells = tile.cells;
  const std::int64_t newest_ns = NewestStamp(cells);
  LayeredGrid grid{kTileCells, kTileCells, CellSizeAt(tile.level, cell_size_m), {}, newest_ns};
  const auto state = [&](std::size_t i) { return cells[i].state; };
  const auto add = [&](Layer layer, auto value) {
    grid.layers.push_back(MakeLayer(layer, cells.size(), state, value));
  };
  for (const Layer layer : layers) {
    switch (layer) {
      case Layer::kElevation:
        add(layer, [&](std::size_t i) { return cells[i].elevation_m; });
        break;
      case Layer::kVariance:
        add(layer, [&](std::size_t i) { return cells[i].variance_m2; });
        break;
      case Layer::kTraversability:
        add(layer, [&](std::size_t i) { return cells[i].traversability; });
        break;
      case Layer::kAge:
        add(layer, [&](std::size_t i) { return AgeSeconds(newest_ns, cells[i].stamp_ns); });
        break;
      case Layer::kColor:
        grid.layers.push_back(
            MakeColorLayer(cells.size(), state, [&](std::size_t i) { return cells[i].rgba; }));
        break;
      case Layer::kSlope:
      case Layer::kRoughness:
        break;  // refused before: tiles have none
    }
  }
  return grid;
}

LayeredGrid GridOf(const LocalMap& map, std::span<const Layer> layers) {
  LayeredGrid grid{
      map.side_cells, map.side_cells, static_cast<double>(map.cell_size_m), {}, map.stamp_ns};
  const auto state = [&](std::size_t i) { return map.state[i]; };
  const auto add = [&](Layer layer, const std::vector<float>& values) {
    grid.layers.push_back(
        MakeLayer(layer, map.num_cells(), state, [&](std::size_t i) { return values[i]; }));
  };
  for (const Layer layer : layers) {
    switch (layer) {
      case Layer::kElevation:
        add(layer, map.elevation_m);
        break;
      case Layer::kVariance:
        add(layer, map.variance_m2);
        break;
      case Layer::kTraversability:
        add(layer, map.traversability);
        break;
      case Layer::kSlope:
        add(layer, map.slope_rad);
        break;
      case Layer::kRoughness:
        add(layer, map.roughness_m);
        break;
      case Layer::kAge:
        grid.layers.push_back(MakeLayer(layer, map.num_cells(), state, [&](std::size_t i) {
          return AgeSeconds(map.stamp_ns, map.observed_ns[i]);
        }));
        break;
      case Layer::kColor:
        grid.layers.push_back(
            MakeColorLayer(map.num_cells(), state, [&](std::size_t i) { return map.rgba[i]; }));
        break;
    }
  }
  return grid;
}

void ToProto(const Tile& tile, float cell_size_m, std::span<const Layer> layers,
             CellEncoding encoding, v1::Tile* proto) {
  ToProto(AddressOf(tile), proto->mutable_key());
  ToProto(tile.version, proto->mutable_version());
  ToProto(GridOf(tile, cell_size_m, layers), encoding, proto->mutable_grid());
}

absl::StatusOr<DecodedTile> FromProto(const v1::Tile& proto, const FieldPath& field,
                                      bool keys_only) {
  DecodedTile tile;
  GEM_ASSIGN_OR_RETURN(tile.address, FromProto(proto.key(), field.Child("key")));
  tile.version = FromProto(proto.version());
  tile.etag = proto.etag();
  switch (proto.content_case()) {
    case v1::Tile::kGrid: {
      GEM_ASSIGN_OR_RETURN(tile.grid, FromProto(proto.grid(), kTileCells, field.Child("grid")));
      if (tile.grid->columns != kTileCells || tile.grid->rows != kTileCells)
        return Refuse(field.Child("grid"),
                      absl::StrCat(tile.grid->columns, " x ", tile.grid->rows, " cells"),
                      absl::StrCat(kTileCells, " x ", kTileCells));
      break;
    }
    case v1::Tile::kAbsent:
      if (!proto.absent()) return Refuse(field.Child("absent"), "false", "true or unset");
      break;
    case v1::Tile::kNotModified:
      if (!proto.not_modified())
        return Refuse(field.Child("not_modified"), "false", "true or unset");
      tile.not_modified = true;
      break;
    case v1::Tile::CONTENT_NOT_SET:
      tile.key_only = keys_only;
      if (keys_only) break;
      return Refuse(field.Child("content"), "unset", "a grid, absent or not_modified");
  }
  return tile;
}

void ToProto(const LocalMap& map, const LocalMapContext& context, std::span<const Layer> layers,
             CellEncoding encoding, v1::LocalMap* proto) {
  HeadToProto(map, context, proto);
  ToProto(GridOf(map, layers), encoding, proto->mutable_grid());
}

void HeadToProto(const LocalMap& map, const LocalMapContext& context, v1::LocalMap* proto) {
  proto->set_stamp_ns(map.stamp_ns);
  proto->set_seq(map.seq);
  proto->set_origin_cell_x(map.origin.x);
  proto->set_origin_cell_y(map.origin.y);
  ToProto(map.T_O_B, proto->mutable_odom_from_base());
  ToProto(context.T_G_O, proto->mutable_map_from_odom());
  proto->set_session(context.session);
  proto->set_traversability_free(map.traversability_free);
}

absl::StatusOr<DecodedLocalMap> FromProto(const v1::LocalMap& proto, const FieldPath& field) {
  DecodedLocalMap map;
  GEM_RETURN_IF_ERROR(CheckStamp(proto.stamp_ns(), field.Child("stamp_ns")));
  map.stamp_ns = proto.stamp_ns();
  map.seq = proto.seq();
  // Origin plus columns must not overflow.
  if (std::abs(std::int64_t{proto.origin_cell_x()}) > kLocalOriginMax)
    return Refuse(field.Child("origin_cell_x"), absl::StrCat(proto.origin_cell_x()),
                  absl::StrCat("at most ", kLocalOriginMax, " in magnitude"));
  if (std::abs(std::int64_t{proto.origin_cell_y()}) > kLocalOriginMax)
    return Refuse(field.Child("origin_cell_y"), absl::StrCat(proto.origin_cell_y()),
                  absl::StrCat("at most ", kLocalOriginMax, " in magnitude"));
  map.origin = {proto.origin_cell_x(), proto.origin_cell_y()};
  GEM_ASSIGN_OR_RETURN(map.grid, FromProto(proto.grid(), kGridCells_max, field.Child("grid")));
  auto T_O_B = FromProto<Odom, Base>(proto.odom_from_base(), field.Child("odom_from_base"));
  if (!T_O_B.ok()) return T_O_B.status();
  map.T_O_B = *T_O_B;
  auto T_G_O = FromProto<Global, Odom>(proto.map_from_odom(), field.Child("map_from_odom"));
  if (!T_G_O.ok()) return T_G_O.status();
  map.T_G_O = *T_G_O;
  map.session = proto.session();
  map.traversability_free = proto.traversability_free();
  return map;
}

void ToProto(const SubmapInfo& submap, double cell_size_m, v1::Submap* proto) {
  proto->set_id(static_cast<std::uint64_t>(submap.origin.id));
  proto->set_session(submap.origin.session);
  absl::btree_set<absl::string_view> robots;
  for (const Contributor& contributor : submap.contributors) {
    robots.insert(contributor.robot);
    proto->add_sessions(contributor.session);
  }
  for (const absl::string_view robot : robots) proto->add_robots(std::string(robot));
  ToProto(submap.T_G_K, proto->mutable_map_from_submap());
  proto->set_anchor_stamp_ns(submap.origin.anchor_stamp_ns);
  proto->set_num_points(submap.num_cells);
  proto->set_first_stamp_ns(submap.first_stamp_ns);
  proto->set_last_stamp_ns(submap.last_stamp_ns);
  proto->set_finished(submap.finished);
  if (submap.rect_G.empty()) return;
  v1::Region* extent = proto->mutable_extent();
  extent->set_x_min(submap.rect_G.min.x * cell_size_m);
  extent->set_y_min(submap.rect_G.min.y * cell_size_m);
  extent->set_x_max(submap.rect_G.max.x * cell_size_m);
  extent->set_y_max(submap.rect_G.max.y * cell_size_m);
}

}  // namespace gem::wire
