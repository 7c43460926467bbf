#include "proto/wire/tile_message.h"

#include "gem/v1/tile_service.pb.h"
#include "gem/v1/types.pb.h"
#include "proto/wire/local_map_message.h"
#include "proto/wire/map.h"
#include "tests/proto/refused.h"

namespace gem::wire {
namespace {

const std::vector<Layer> kElevationOnly = {Layer::kElevation};

/// One known cell, of level 2.
Tile SomeTile() {
  Tile tile;
  tile.level = 2;
  tile.index = {-2, 7};
  tile.version = {4, 9};
  tile.cells.resize(kTileCells * kTileCells);
  tile.cells[645] = {1.25f, 0.01f, 0.75f, 0xff0000ff, 3'000'000'000, kCellKnown | kCellAnnotated};
  return tile;
}

std::uint64_t EtagOf(const Tile& tile, const std::vector<Layer>& layers = kElevationOnly,
                     CellEncoding encoding = CellEncoding::kRaw, float cell_size_m = 0.5f) {
  return EncodeTile(tile, cell_size_m, layers, encoding).etag;
}

TEST(EncodedTile, IsATileWithItsEtag) {
  const EncodedCells encoded = EncodeTile(SomeTile(), 0.5f, kElevationOnly, CellEncoding::kRaw);
  v1::Tile proto;
  ASSERT_TRUE(proto.ParseFromString(encoded.bytes));
  const auto tile = FromProto(proto, FieldPath("tile"));
  ASSERT_TRUE(tile.ok()) << tile.status();
  EXPECT_EQ(tile->address, (TileAddress{2, {-2, 7}}));
  EXPECT_EQ(tile->version, (MapVersion{4, 9}));
  EXPECT_EQ(tile->etag, encoded.etag);
  EXPECT_NE(tile->etag, 0u);
  // 0.5 m at level 0.
  EXPECT_EQ(tile->grid->cell_size_m, 2.0);
  EXPECT_EQ(tile->grid->Find(Layer::kElevation)->values[645], 1.25f);
  EXPECT_EQ(proto.grid().stamp_ns(), 3'000'000'000);
}

TEST(Etag, IsTheSameForTheSameCellsOfAnotherVersion) {
  Tile later = SomeTile();
  later.version = {5, 1};
  EXPECT_EQ(EtagOf(later), EtagOf(SomeTile()));
}

TEST(Etag, DependsOnWhatAClientCanSee) {
  const std::uint64_t etag = EtagOf(SomeTile());
  Tile other = SomeTile();
  other.cells[645].elevation_m = 1.5f;
  EXPECT_NE(EtagOf(other), etag);
  other = SomeTile();
  other.cells[646] = other.cells[645];
  EXPECT_NE(EtagOf(other), etag);
  other = SomeTile();
  other.index.x = 3;
  EXPECT_NE(EtagOf(other), etag);
  other = SomeTile();
  other.level = 1;
  EXPECT_NE(EtagOf(other), etag);
  EXPECT_NE(EtagOf(SomeTile(), kElevationOnly, CellEncoding::kCompact), etag);
  EXPECT_NE(EtagOf(SomeTile(), {Layer::kElevation, Layer::kVariance}), etag);
  EXPECT_NE(EtagOf(SomeTile(), kElevationOnly, CellEncoding::kRaw, 0.25f), etag);
}

TEST(Etag, DoesNotDependOnWhatWasNotAskedFor) {
  Tile other = SomeTile();
  other.cells[645].variance_m2 = 0.5f;
  other.cells[645].stamp_ns = 9'000'000'000;
  EXPECT_EQ(EtagOf(other), EtagOf(SomeTile()));
  const std::vector<Layer> age = {Layer::kAge};
  EXPECT_NE(EtagOf(other, age), EtagOf(SomeTile(), age));
}

// Clients keep etags over a restart and an update of the server. This one changes only if raw tiles
// do.
TEST(Etag, IsThisNumber) { EXPECT_EQ(EtagOf(SomeTile()), 13219472307191443017u); }

TEST(TileMessage, IsTheAnswerThatProtobufReads) {
  const auto encoded = std::make_shared<const EncodedCells>(
      EncodeTile(SomeTile(), 0.5f, kElevationOnly, CellEncoding::kCompact));
  TileMessage message(TileMessage::Kind::kBatch);
  message.Add(encoded);
  message.AddAbsent({1, {5, -6}}, {4, 10});
  message.AddNotModified(SomeTile(), 77);
  message.Add(encoded);
  const SplicedMessage batch = std::move(message).FinishBatch({4, 10});
  const std::string bytes = batch.Flattened();
  EXPECT_EQ(bytes.size(), batch.size_bytes());
  v1::BatchGetTilesResponse proto;
  ASSERT_TRUE(proto.ParseFromString(bytes));
  ASSERT_EQ(proto.tiles_size(), 4);
  EXPECT_EQ(proto.tiles(0).SerializeAsString(), encoded->bytes);
  EXPECT_TRUE(proto.tiles(1).absent());
  EXPECT_EQ(proto.tiles(1).key().level(), 1u);
  EXPECT_EQ(proto.tiles(1).key().y(), -6);
  EXPECT_EQ(proto.tiles(1).version().revision(), 10u);
  EXPECT_TRUE(proto.tiles(2).not_modified());
  EXPECT_EQ(proto.tiles(2).etag(), 77u);
  EXPECT_EQ(proto.tiles(3).etag(), encoded->etag);
  EXPECT_EQ(proto.version().epoch(), 4u);
}

TEST(TileMessage, SharesTheCells) {
  const auto encoded = std::make_shared<const EncodedCells>(
      EncodeTile(SomeTile(), 0.5f, kElevationOnly, CellEncoding::kRaw));
  TileMessage message(TileMessage::Kind::kStream);
  message.Add(encoded);
  const SplicedMessage stream = std::move(message).FinishStream({4, 9}, true, true);
  // Header, cells, rest.
  ASSERT_EQ(stream.parts().size(), 3u);
  EXPECT_EQ(stream.parts()[1].shared.get(), &encoded->bytes);
  v1::StreamTilesResponse proto;
  ASSERT_TRUE(proto.ParseFromString(stream.Flattened()));
  EXPECT_EQ(proto.tiles_size(), 1);
  EXPECT_TRUE(proto.reset());
  EXPECT_TRUE(proto.complete());
}

TEST(TileMessage, AWatchSaysFromWhereToWhere) {
  TileMessage message(TileMessage::Kind::kWatch);
  message.AddKeyOnly(SomeTile(), 55);
  TileMessage::WatchEnd end;
  end.base = MapVersion{4, 6};
  end.version = {4, 9};
  end.complete = true;
  end.num_versions_skipped = 2;
  v1::WatchTilesResponse proto;
  ASSERT_TRUE(proto.ParseFromString(std::move(message).FinishWatch(end).Flattened()));
  EXPECT_EQ(proto.base().revision(), 6u);
  EXPECT_EQ(proto.version().revision(), 9u);
  EXPECT_FALSE(proto.reset());
  EXPECT_TRUE(proto.complete());
  EXPECT_EQ(proto.num_versions_skipped(), 2u);
  ASSERT_EQ(proto.tiles_size(), 1);
  const auto tile = FromProto(proto.tiles(0), FieldPath("tile"), /*keys_only=*/true);
  ASSERT_TRUE(tile.ok()) << tile.status();
  EXPECT_TRUE(tile->key_only);
  EXPECT_EQ(tile->etag, 55u);
}

TEST(LocalMapMessage, IsTheAnswerThatProtobufReads) {
  LocalMap map;
  map.stamp_ns = 2'000'000'000;
  map.seq = 17;
  map.origin = {-7, 4};
  map.side_cells = 2;
  map.cell_size_m = 0.5f;
  map.ResizeLayers(4);
  map.state[1] = kCellKnown;
  map.elevation_m[1] = 3;
  const LocalMapContext context{Pose<Global, Odom>::FromTranslation(9, 8, 7), "s1"};
  const auto grid =
      std::make_shared<const EncodedCells>(EncodeGrid(map, kElevationOnly, CellEncoding::kRaw));
  v1::WatchLocalMapResponse watched;
  ASSERT_TRUE(watched.ParseFromString(WatchLocalMapMessage(map, context, grid, 5).Flattened()));
  EXPECT_EQ(watched.num_skipped(), 5u);
  v1::GetLocalMapResponse got;
  ASSERT_TRUE(got.ParseFromString(GetLocalMapMessage(map, context, grid).Flattened()));
  // The same message as if it had been made in one piece.
  v1::LocalMap want;
  ToProto(map, context, kElevationOnly, CellEncoding::kRaw, &want);
  EXPECT_EQ(got.local_map().SerializeAsString(), want.SerializeAsString());
  EXPECT_EQ(watched.local_map().SerializeAsString(), want.SerializeAsString());
}

}  // namespace
}  // namespace gem::wire
