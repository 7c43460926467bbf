#include "proto/wire/map.h"

#include "gem/v1/tile_service.pb.h"
#include "gem/v1/types.pb.h"
#include "tests/proto/refused.h"

namespace gem::wire {
namespace {

/// All cells unknown but (3, 5) and (4, 5), which was seen 2 s later.
Tile TwoCells() {
  Tile tile{0, {-2, 7}, {4, 9}, std::vector<CellBelief>(kTileCells * kTileCells)};
  tile.cells[5 * 128 + 3] = {1.25f,      0.01f,         0.75f,
                             0xff0000ff, 3'000'000'000, kCellKnown | kCellAnnotated | kCellColored};
  tile.cells[5 * 128 + 4] = {1, 0.02f, 0, 0, 5'000'000'000, kCellKnown};
  return tile;
}

TEST(Tile, SurvivesTheRoundTrip) {
  v1::Tile proto;
  ToProto(TwoCells(), 0.5f, TileLayers(), CellEncoding::kRaw, &proto);
  const auto tile = FromProto(proto, FieldPath("tile"));
  ASSERT_TRUE(tile.ok()) << tile.status();
  EXPECT_EQ(tile->address, (TileAddress{0, {-2, 7}}));
  EXPECT_EQ(tile->version, (MapVersion{4, 9}));
  ASSERT_TRUE(tile->grid.has_value());
  const std::size_t cell = 5 * 128 + 3;
  for (const Layer layer : TileLayers()) {
    const GridLayer* got = tile->grid->Find(layer);
    ASSERT_NE(got, nullptr);
    EXPECT_EQ(got->valid[cell], 1);
    EXPECT_EQ(got->valid[cell + 2], 0);
  }
  EXPECT_EQ(tile->grid->Find(Layer::kElevation)->values[cell], 1.25f);
  EXPECT_EQ(tile->grid->Find(Layer::kVariance)->values[cell], 0.01f);
  EXPECT_EQ(tile->grid->Find(Layer::kTraversability)->values[cell], 0.75f);
  EXPECT_EQ(tile->grid->Find(Layer::kColor)->colors[cell], 0xff0000ff);
  EXPECT_EQ(tile->grid->Find(Layer::kAge)->values[cell], 2.0f);
  EXPECT_EQ(tile->grid->Find(Layer::kAge)->values[cell + 1], 0.0f);
  EXPECT_EQ(tile->grid->stamp_ns, 5'000'000'000) << "of the newest observation in the tile";
}

TEST(Tile, OfACoarserLevelHasWiderCells) {
  Tile coarse = TwoCells();
  coarse.level = 3;
  v1::Tile proto;
  ToProto(coarse, 0.5f, TileLayers(), CellEncoding::kCompact, &proto);
  const auto tile = FromProto(proto, FieldPath("tile"));
  ASSERT_TRUE(tile.ok()) << tile.status();
  EXPECT_EQ(tile->address, (TileAddress{3, {-2, 7}}));
  EXPECT_EQ(tile->grid->cell_size_m, 4.0);
}

TEST(Tile, ThatStaysAsItIsEncodesToTheSameBytes) {
  // Etags and caches rely on it, also for tiles that another thread or process encoded in between.
  v1::Tile first, other, second;
  ToProto(TwoCells(), 0.5f, TileLayers(), CellEncoding::kCompact, &first);
  Tile bumpy = TwoCells();
  for (std::size_t i = 0; i < bumpy.cells.size(); ++i)
    bumpy.cells[i] = {static_cast<float>(i * i % 97), 0.1f, 0, 0, 1, kCellKnown};
  ToProto(bumpy, 0.5f, TileLayers(), CellEncoding::kCompact, &other);
  ToProto(TwoCells(), 0.5f, TileLayers(), CellEncoding::kCompact, &second);
  EXPECT_EQ(first.SerializeAsString(), second.SerializeAsString());
}

TEST(Tile, ACellThatIsNotAnnotatedHasNoTraversability) {
  Tile tile = TwoCells();
  tile.cells[5 * 128 + 3].state = kCellKnown;
  const LayeredGrid grid = GridOf(tile, 0.5f, TileLayers());
  EXPECT_EQ(grid.Find(Layer::kElevation)->valid[5 * 128 + 3], 1);
  EXPECT_EQ(grid.Find(Layer::kTraversability)->valid[5 * 128 + 3], 0);
  EXPECT_EQ(grid.Find(Layer::kColor)->valid[5 * 128 + 3], 0);
}

TEST(Tile, AbsentIsNoGrid) {
  v1::Tile proto;
  proto.mutable_key()->set_x(1);
  EXPECT_THAT(
      FromProto(proto, FieldPath("tile")),
      Refused("tile.content", "tile.content is unset, want a grid, absent or not_modified"));
  const auto key = FromProto(proto, FieldPath("tile"), /*keys_only=*/true);
  ASSERT_TRUE(key.ok()) << key.status();
  EXPECT_TRUE(key->key_only);
  proto.set_absent(true);
  const auto tile = FromProto(proto, FieldPath("tile"));
  ASSERT_TRUE(tile.ok()) << tile.status();
  EXPECT_FALSE(tile->grid.has_value());
}

TEST(Tile, RefusesAnotherSize) {
  v1::Tile proto;
  ToProto(TwoCells(), 0.5f, TileLayers(), CellEncoding::kRaw, &proto);
  proto.mutable_grid()->set_columns(129);
  EXPECT_THAT(FromProto(proto, FieldPath("tile")),
              Refused("tile.grid.columns", "tile.grid.columns is 129, want 1 to 128"));
}

TEST(TileKey, RefusesLevelsAndAddressesThatDoNotExist) {
  v1::TileKey proto;
  proto.set_level(7);
  EXPECT_THAT(FromProto(proto, FieldPath("key")),
              Refused("key.level", "key.level is 7, want 0 to 6"));
  proto.set_level(6);
  proto.set_x(-8388609);
  EXPECT_THAT(FromProto(proto, FieldPath("key")),
              Refused("key.x", "key.x is -8388609, want at most 8388608 in magnitude"));
  proto.set_x(-1);
  proto.set_y(-3);
  EXPECT_EQ(*FromProto(proto, FieldPath("key")), (TileAddress{6, {-1, -3}}));
}

LocalMap SmallLocalMap() {
  LocalMap map;
  map.stamp_ns = 2'000'000'000;
  map.seq = 17;
  map.T_O_B = Pose<Odom, Base>::FromTranslation(1, 2, 3);
  map.origin = {-7, 4};
  map.side_cells = 2;
  map.cell_size_m = 0.5f;
  map.traversability_free = 0.7f;
  map.state = {0, kCellKnown, kCellKnown | kCellAnnotated, 0};
  map.elevation_m = {0, 1, 2, 0};
  map.variance_m2 = {0, 0.1f, 0.2f, 0};
  map.slope_rad = {0, 0, 0.3f, 0};
  map.roughness_m = {0, 0, 0.04f, 0};
  map.traversability = {0, 0, 0.9f, 0};
  map.rgba = {0, 0, 0, 0};
  map.observed_ns = {0, 1'500'000'000, 2'000'000'000, 0};
  return map;
}

TEST(LocalMap, SurvivesTheRoundTrip) {
  v1::LocalMap proto;
  ToProto(SmallLocalMap(), {Pose<Global, Odom>::FromTranslation(9, 8, 7), "s1"}, LocalMapLayers(),
          CellEncoding::kRaw, &proto);
  const auto map = FromProto(proto, FieldPath("local_map"));
  ASSERT_TRUE(map.ok()) << map.status();
  EXPECT_EQ(map->stamp_ns, 2'000'000'000);
  EXPECT_EQ(map->seq, 17u);
  EXPECT_EQ(map->origin, (CellIndex{-7, 4}));
  EXPECT_EQ(map->session, "s1");
  EXPECT_EQ(map->traversability_free, 0.7f);
  EXPECT_EQ(map->T_O_B.translation(), Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(map->T_G_O.translation(), Eigen::Vector3d(9, 8, 7));
  ASSERT_EQ(map->grid.layers.size(), 7u);
  const GridLayer* slope = map->grid.Find(Layer::kSlope);
  EXPECT_EQ(slope->valid, (std::vector<std::uint8_t>{0, 0, 1, 0}));
  EXPECT_EQ(slope->values[2], 0.3f);
  EXPECT_EQ(map->grid.Find(Layer::kRoughness)->values[2], 0.04f);
  EXPECT_EQ(map->grid.Find(Layer::kAge)->values[1], 0.5f);
  EXPECT_EQ(map->grid.stamp_ns, 2'000'000'000);
}

TEST(LocalMap, RefusesAnOriginThatWouldOverflow) {
  v1::LocalMap proto;
  ToProto(SmallLocalMap(), {}, LocalMapLayers(), CellEncoding::kRaw, &proto);
  proto.set_origin_cell_x(std::numeric_limits<std::int32_t>::min());
  EXPECT_EQ(FieldOf(FromProto(proto, FieldPath("local_map")).status()), "local_map.origin_cell_x");
}

}  // namespace
}  // namespace gem::wire
