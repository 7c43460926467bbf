#include "proto/wire/tile_request.h"

#include <algorithm>

#include "absl/strings/str_cat.h"
#include "core/base/status_macros.h"
#include "gem/v1/tile_service.pb.h"
#include "gem/v1/types.pb.h"
#include "proto/wire/map.h"
#include "proto/wire/refusal.h"
#include "proto/wire/region.h"
#include "proto/wire/scalar.h"

namespace gem::wire {
namespace {

template <typename Request>
absl::StatusOr<CellSelection> CellsOf(const Request& proto, const std::vector<Layer>& served) {
  CellSelection cells;
  GEM_ASSIGN_OR_RETURN(cells.layers, LayersFromProto({proto.layers().begin(), proto.layers().end()},
                                                     served, FieldPath("layers")));
  std::sort(cells.layers.begin(), cells.layers.end());
  GEM_ASSIGN_OR_RETURN(cells.encoding, EncodingFromProto(proto.encoding(), FieldPath("encoding")));
  return cells;
}

/// Map, region, level and cells of a request that has all of them.
template <typename Request, typename Result>
absl::Status ViewFromProto(const Request& proto, Result& result) {
  GEM_RETURN_IF_ERROR(CheckId(proto.map(), FieldPath("map")));
  result.map = proto.map();
  if (proto.has_region()) {
    GEM_ASSIGN_OR_RETURN(result.region, FromProto(proto.region(), FieldPath("region")));
  }
  GEM_ASSIGN_OR_RETURN(result.level, LevelFromProto(proto.level(), FieldPath("level")));
  GEM_ASSIGN_OR_RETURN(result.cells, CellsOf(proto, TileLayers()));
  return absl::OkStatus();
}

absl::StatusOr<double> MinIntervalFromProto(double min_interval_s) {
  // Written so that NaN is refused.
  if (min_interval_s >= 0 && min_interval_s <= kMinInterval_sMax) return min_interval_s;
  return Refuse(FieldPath("min_interval_s"), min_interval_s,
                absl::StrCat("0 to ", kMinInterval_sMax));
}

template <typename Request>
absl::StatusOr<LocalMapRequest> LocalMapRequestFromProto(const Request& proto) {
  LocalMapRequest request;
  GEM_RETURN_IF_ERROR(CheckId(proto.robot(), FieldPath("robot")));
  request.robot = proto.robot();
  GEM_ASSIGN_OR_RETURN(request.cells, CellsOf(proto, LocalMapLayers()));
  return request;
}

}  // namespace

absl::StatusOr<TileMatrixRequest> FromProto(const v1::GetTileMatrixRequest& proto) {
  GEM_RETURN_IF_ERROR(CheckId(proto.map(), FieldPath("map")));
  GEM_ASSIGN_OR_RETURN(const int level, LevelFromProto(proto.level(), FieldPath("level")));
  return TileMatrixRequest{proto.map(), level};
}

absl::StatusOr<BatchRequest> FromProto(const v1::BatchGetTilesRequest& proto) {
  const FieldPath tiles("tiles");
  BatchRequest request;
  GEM_RETURN_IF_ERROR(CheckId(proto.map(), FieldPath("map")));
  request.map = proto.map();
  if (proto.tiles_size() < 1 || proto.tiles_size() > kTilesOfBatch_max)
    return Refuse(tiles, absl::StrCat(proto.tiles_size(), " tiles"),
                  absl::StrCat("1 to ", kTilesOfBatch_max));
  for (const v1::TileKey& key : proto.tiles()) {
    GEM_ASSIGN_OR_RETURN(const TileAddress address, FromProto(key, tiles.At(request.tiles.size())));
    request.tiles.push_back(address);
  }
  GEM_ASSIGN_OR_RETURN(request.cells, CellsOf(proto, TileLayers()));
  if (proto.has_at()) request.at = FromProto(proto.at());
  if (proto.if_none_match_size() != 0 && proto.if_none_match_size() != proto.tiles_size())
    return Refuse(FieldPath("if_none_match"), absl::StrCat(proto.if_none_match_size(), " etags"),
                  absl::StrCat("none or ", proto.tiles_size(), ", one for each of tiles"));
  request.if_none_match.assign(proto.if_none_match().begin(), proto.if_none_match().end());
  return request;
}

absl::StatusOr<StreamRequest> FromProto(const v1::StreamTilesRequest& proto) {
  StreamRequest request;
  GEM_RETURN_IF_ERROR(ViewFromProto(proto, request));
  if (proto.has_changed_after()) request.changed_after = FromProto(proto.changed_after());
  if (proto.has_nearest_to()) {
    GEM_ASSIGN_OR_RETURN(request.nearest_to,
                         FromProto(proto.nearest_to(), FieldPath("nearest_to")));
  }
  return request;
}

absl::StatusOr<WatchRequest> FromProto(const v1::WatchTilesRequest& proto) {
  WatchRequest request;
  GEM_RETURN_IF_ERROR(ViewFromProto(proto, request));
  if (proto.has_resume_from()) request.resume_from = FromProto(proto.resume_from());
  GEM_ASSIGN_OR_RETURN(request.min_interval_s, MinIntervalFromProto(proto.min_interval_s()));
  if (proto.bytes_per_s_max() != 0 && proto.bytes_per_s_max() < kBytesPerSecondMin)
    return Refuse(FieldPath("bytes_per_s_max"), absl::StrCat(proto.bytes_per_s_max()),
                  absl::StrCat("0 or at least ", kBytesPerSecondMin));
  request.bytes_per_s_max = proto.bytes_per_s_max();
  request.keys_only = proto.keys_only();
  return request;
}

absl::StatusOr<LocalMapRequest> FromProto(const v1::GetLocalMapRequest& proto) {
  return LocalMapRequestFromProto(proto);
}

absl::StatusOr<LocalMapRequest> FromProto(const v1::WatchLocalMapRequest& proto) {
  GEM_ASSIGN_OR_RETURN(LocalMapRequest request, LocalMapRequestFromProto(proto));
  GEM_ASSIGN_OR_RETURN(request.min_interval_s, MinIntervalFromProto(proto.min_interval_s()));
  return request;
}

}  // namespace gem::wire
