// What readers get: tiles, local maps, versions, submaps <-> gem.v1.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "core/global/map_snapshot.h"
#include "core/grid/layered_grid.h"
#include "core/local/local_map.h"
#include "proto/wire/field_path.h"
#include "proto/wire/grid.h"

namespace gem::v1 {
class LocalMap;
class MapVersion;
class Submap;
class Tile;
class TileKey;
}  // namespace gem::v1

namespace gem::wire {

/// Layers that tiles have: no slope and no roughness.
const std::vector<Layer>& TileLayers();
/// Layers that local maps have: all.
const std::vector<Layer>& LocalMapLayers();

void ToProto(const MapVersion& version, v1::MapVersion* proto);
MapVersion FromProto(const v1::MapVersion& proto);

void ToProto(const TileAddress& address, v1::TileKey* proto);
/// Level 0 to kLevelMax, and |x|, |y| at most 2^23, so that the cell indices fit 32 bits.
absl::StatusOr<TileAddress> FromProto(const v1::TileKey& proto, const FieldPath& field);
/// A level that stands alone: 0 to kLevelMax.
absl::StatusOr<int> LevelFromProto(std::uint32_t level, const FieldPath& field);

/// The cells of a tile by layers. cell_size_m: of level 0. Ages count back from the newest
/// observation in the tile, so that a tile that stays as it is has the same ages for ever.
LayeredGrid GridOf(const Tile& tile, float cell_size_m, std::span<const Layer> layers);
/// The cells of a local map by layers. Ages count back from the map's stamp.
LayeredGrid GridOf(const LocalMap& map, std::span<const Layer> layers);

/// Key, version and cells. The same cells give the same bytes.
void ToProto(const Tile& tile, float cell_size_m, std::span<const Layer> layers,
             CellEncoding encoding, v1::Tile* proto);

/// A tile as a client sees it. No grid: absent, unless it is not_modified or key_only.
struct DecodedTile {
  TileAddress address;
  MapVersion version;
  std::uint64_t etag = 0;  ///< 0: the server sent none
  bool not_modified = false;
  bool key_only = false;  ///< there are cells, but they were not asked for
  std::optional<LayeredGrid> grid;
};
/// keys_only: tiles without any content are legal.
absl::StatusOr<DecodedTile> FromProto(const v1::Tile& proto, const FieldPath& field,
                                      bool keys_only = false);

/// What a local map comes with.
struct LocalMapContext {
  Pose<Global, Odom> T_G_O;  ///< at the map's stamp
  std::string session;
};
void ToProto(const LocalMap& map, const LocalMapContext& context, std::span<const Layer> layers,
             CellEncoding encoding, v1::LocalMap* proto);

/// A local map as a client sees it.
struct DecodedLocalMap {
  std::int64_t stamp_ns = 0;
  std::uint64_t seq = 0;
  CellIndex origin;  ///< cell of O at column 0, row 0
  LayeredGrid grid;
  Pose<Odom, Base> T_O_B;
  Pose<Global, Odom> T_G_O;
  std::string session;
  float traversability_free = 0;
};
absl::StatusOr<DecodedLocalMap> FromProto(const v1::LocalMap& proto, const FieldPath& field);
/// All but the grid.
void HeadToProto(const LocalMap& map, const LocalMapContext& context, v1::LocalMap* proto);

/// cell_size_m: of the map.
void ToProto(const SubmapInfo& submap, double cell_size_m, v1::Submap* proto);

}  // namespace gem::wire
