#include "proto/wire/tile_request.h"

#include <cmath>
#include <limits>

#include "gem/v1/tile_service.pb.h"
#include "gem/v1/types.pb.h"
#include "tests/proto/refused.h"

namespace gem::wire {
namespace {

v1::WatchTilesRequest Watch() {
  v1::WatchTilesRequest proto;
  proto.set_map("site");
  return proto;
}

template <typename Spoil>
absl::Status WatchStatus(Spoil spoil) {
  v1::WatchTilesRequest proto = Watch();
  spoil(proto);
  return FromProto(proto).status();
}

TEST(WatchTilesRequest, UnsetFieldsMeanTheWholeMapAtOnceWithoutLimit) {
  const auto request = FromProto(Watch());
  ASSERT_TRUE(request.ok()) << request.status();
  EXPECT_EQ(request->region, std::nullopt);
  EXPECT_EQ(request->resume_from, std::nullopt);
  EXPECT_EQ(request->level, 0);
  EXPECT_EQ(request->min_interval_s, 0);
  EXPECT_EQ(request->bytes_per_s_max, 0u);
  EXPECT_EQ(request->cells.layers, std::vector<Layer>{Layer::kElevation});
}

TEST(WatchTilesRequest, NamesWhatItRefuses) {
  const auto region = [](double x_min, double y_min, double x_max, double y_max) {
    return [=](v1::WatchTilesRequest& r) {
      r.mutable_region()->set_x_min(x_min);
      r.mutable_region()->set_y_min(y_min);
      r.mutable_region()->set_x_max(x_max);
      r.mutable_region()->set_y_max(y_max);
    };
  };
  EXPECT_EQ(WatchStatus(region(0, 0, 1, 1)), absl::OkStatus());
  EXPECT_EQ(WatchStatus(region(0, 0, 0, 1)).message(), "region.x_max is 0, want more than 0");
  EXPECT_EQ(WatchStatus(region(0, 5, 1, 4)).message(), "region.y_max is 4, want more than 5");
  EXPECT_EQ(WatchStatus(region(-2e6, 0, 1, 1)).message(),
            "region.x_min is -2e+06, want at most 1e+06 in magnitude");
  EXPECT_EQ(WatchStatus(region(0, 0, 1, std::nan(""))).message(),
            "region.y_max is nan, want at most 1e+06 in magnitude");
  EXPECT_EQ(WatchStatus([](auto& r) { r.set_map("a b"); }).code(),
            absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(WatchStatus([](auto& r) { r.set_level(7); }).message(), "level is 7, want 0 to 6");
  EXPECT_EQ(WatchStatus([](auto& r) { r.set_min_interval_s(-1); }).message(),
            "min_interval_s is -1, want 0 to 3600");
  EXPECT_EQ(WatchStatus([](auto& r) {
              r.set_min_interval_s(std::numeric_limits<double>::quiet_NaN());
            }).message(),
            "min_interval_s is nan, want 0 to 3600");
  EXPECT_EQ(WatchStatus([](auto& r) { r.set_bytes_per_s_max(1023); }).message(),
            "bytes_per_s_max is 1023, want 0 or at least 1024");
  EXPECT_EQ(WatchStatus([](auto& r) { r.set_bytes_per_s_max(1024); }), absl::OkStatus());
}

TEST(BatchGetTilesRequest, TakesNoEtagsOrOneForEachTile) {
  v1::BatchGetTilesRequest proto;
  proto.set_map("site");
  proto.add_tiles()->set_x(1);
  proto.add_tiles()->set_level(3);
  proto.add_if_none_match(5);
  EXPECT_THAT(
      FromProto(proto),
      Refused("if_none_match", "if_none_match is 1 etags, want none or 2, one for each of tiles"));
  proto.add_if_none_match(0);
  proto.mutable_at()->set_revision(4);
  const auto request = FromProto(proto);
  ASSERT_TRUE(request.ok()) << request.status();
  EXPECT_EQ(request->if_none_match, (std::vector<std::uint64_t>{5, 0}));
  EXPECT_EQ(request->tiles[1], (TileAddress{3, {0, 0}}));
  EXPECT_EQ(request->at, (MapVersion{0, 4}));
}

TEST(BatchGetTilesRequest, TheOrderOfLayersMeansNothing) {
  v1::BatchGetTilesRequest proto;
  proto.set_map("site");
  proto.add_tiles();
  proto.add_layers(v1::LAYER_COLOR);
  proto.add_layers(v1::LAYER_ELEVATION);
  EXPECT_EQ(FromProto(proto)->cells.layers, (std::vector<Layer>{Layer::kElevation, Layer::kColor}));
}

TEST(StreamTilesRequest, HasAPlaceThatIsCheckedLikeAnyOther) {
  v1::StreamTilesRequest proto;
  proto.set_map("site");
  proto.mutable_nearest_to()->set_x(3);
  EXPECT_EQ(FromProto(proto)->nearest_to, (Place{3, 0}));
  proto.mutable_nearest_to()->set_y(1e7);
  EXPECT_THAT(FromProto(proto),
              Refused("nearest_to.y", "nearest_to.y is 1e+07, want at most 1e+06 in magnitude"));
}

}  // namespace
}  // namespace gem::wire
