#include "client/map_client.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <random>
#include <span>
#include <thread>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/calls/map_stubs.h"
#include "core/base/status_macros.h"
#include "proto/wire/correction.h"
#include "proto/wire/map.h"
#include "proto/wire/pose.h"

namespace gem::client {
namespace {

constexpr std::size_t kTilesOfBatchMax = 64;
constexpr std::uint32_t kPageSize = 1000;
/// A server that never ends its pages must not fill our memory.
constexpr int kPagesMax = 100'000;
/// Tiles of one map: 4 million are 65,000 km^2 at 1 m.
constexpr int kTilesMax = 1 << 22;
constexpr auto kCorrectionPause = std::chrono::milliseconds(200);

MapInfo FromProto(const v1::Map& proto) {
  return {proto.id(),
          proto.cell_size_m(),
          proto.submap_length_m(),
          proto.traversable_only(),
          wire::FromProto(proto.version()),
          proto.num_submaps(),
          proto.num_points(),
          proto.submap_bytes(),
          proto.num_tiles(),
          {proto.sessions().begin(), proto.sessions().end()}};
}

absl::StatusOr<SubmapInfo> FromProto(const v1::Submap& proto, const wire::FieldPath& field) {
  auto T_G_K =
      wire::FromProto<Global, Submap>(proto.map_from_submap(), field.Child("map_from_submap"));
  if (!T_G_K.ok()) return T_G_K.status();
  return SubmapInfo{proto.id(),
                    proto.session(),
                    {proto.robots().begin(), proto.robots().end()},
                    *T_G_K,
                    proto.anchor_stamp_ns(),
                    proto.num_points(),
                    proto.first_stamp_ns(),
                    proto.last_stamp_ns(),
                    proto.finished()};
}

template <typename Proto>
std::vector<TimingBucket> BucketsOf(const Proto& proto) {
  std::vector<TimingBucket> buckets;
  for (const v1::TimingBucket& bucket : proto.buckets())
    buckets.push_back({bucket.upper_s(), bucket.count()});
  return buckets;
}

ServerStatus FromProto(const v1::GetServerStatusResponse& proto) {
  ServerStatus status{proto.server_version(), proto.backend(), proto.uptime_s(), {}, {}};
  for (const v1::SessionStatus& s : proto.sessions())
    status.sessions.push_back({s.map(), s.robot(), s.session(), s.active(), s.connected(),
                               s.num_scans_fused(), s.num_scans_refused(), s.queue_bytes(),
                               s.fused_seq(), s.oldest_s()});
  for (const v1::StageTiming& t : proto.timings())
    status.timings.push_back(
        {t.mapper(), t.stage(), t.count(), t.total_s(), t.max_s(), BucketsOf(t)});
  for (const v1::CallStatus& c : proto.calls())
    status.calls.push_back({c.method(), c.num_started(), c.num_failed(), c.num_active(),
                            c.received_bytes(), c.sent_bytes(), c.total_s(), BucketsOf(c)});
  for (const v1::MapLag& l : proto.lags())
    status.lags.push_back(
        {l.map(), l.staleness_s(), l.version_age_s(), l.num_corrections_waiting()});
  const v1::ProcessStatus& process = proto.process();
  status.process = {process.resident_bytes(), process.cpu_s(), process.num_threads(),
                    process.num_open_files()};
  status.tiles = {proto.tiles().num_full(), proto.tiles().num_absent()};
  return status;
}

template <typename Request>
void Select(const CellSelection& selection, Request& request) {
  for (const Layer layer : selection.layers)
    request.add_layers(static_cast<v1::Layer>(wire::ToProto(layer)));
  request.set_encoding(selection.encoding == CellEncoding::kRaw ? v1::CELL_ENCODING_RAW
                                                                : v1::CELL_ENCODING_COMPACT);
}

/// What the server sent must be what was asked for: maps are drawn from it.
absl::Status CheckTile(const wire::DecodedTile& tile, const TileAddress& wanted,
                       const CellSelection& selection) {
  if (tile.address != wanted)
    return absl::InternalError(absl::StrCat("the server sent tile (", tile.address.level, ", ",
                                            tile.address.index.x, ", ", tile.address.index.y,
                                            ") instead of (", wanted.level, ", ", wanted.index.x,
                                            ", ", wanted.index.y, ")"));
  if (!tile.grid) return absl::OkStatus();
  if (tile.grid->columns != kTileCells || tile.grid->rows != kTileCells)
    return absl::InternalError(absl::StrCat("the server sent a tile of ", tile.grid->columns, " x ",
                                            tile.grid->rows, " cells, want ", kTileCells, " x ",
                                            kTileCells));
  for (const Layer layer : selection.layers)
    if (tile.grid->Find(layer) == nullptr)
      return absl::InternalError(
          absl::StrCat("the server sent a tile without layer ", NameOf(layer)));
  return absl::OkStatus();
}

/// True if tile and region share a cell's area.
bool Touches(TileIndex tile, const Region& region, double cell_size_m) {
  const double side_m = cell_size_m * kTileCells;
  return tile.x * side_m < region.x_m_max && (tile.x + 1) * side_m > region.x_m_min &&
         tile.y * side_m < region.y_m_max && (tile.y + 1) * side_m > region.y_m_min;
}

absl::Status NeverStillError(const std::string& map, int tries) {
  return absl::AbortedError(
      absl::StrCat("map ", map, " changed ", tries, " times while it was read"));
}

}  // namespace

MapClient::MapClient(std::shared_ptr<const Connection> connection, MapClientOptions options)
    : connection_(std::move(connection)),
      options_(options),
      stubs_(std::make_unique<Stubs>(*connection_)) {}

MapClient::~MapClient() = default;

absl::StatusOr<MapInfo> MapClient::GetMap(const std::string& map) const {
  v1::GetMapRequest request;
  v1::GetMapResponse response;
  request.set_map(map);
  GEM_RETURN_IF_ERROR(stubs_->Call(*stubs_->map, &v1::MapService::Stub::GetMap, options_.deadline_s,
                                   request, response));
  return FromProto(response.map());
}

absl::StatusOr<std::vector<MapInfo>> MapClient::ListMaps() const {
  std::vector<MapInfo> maps;
  v1::ListMapsRequest request;
  request.set_page_size(kPageSize);
  for (int page = 0; page < kPagesMax; ++page) {
    v1::ListMapsResponse response;
    GEM_RETURN_IF_ERROR(stubs_->Call(*stubs_->map, &v1::MapService::Stub::ListMaps,
                                     options_.deadline_s, request, response));
    for (const v1::Map& map : response.maps()) maps.push_back(FromProto(map));
    if (response.next_page_token().empty()) return maps;
    request.set_page_token(response.next_page_token());
  }
  return absl::InternalError(absl::StrCat("the list of maps has more than ", kPagesMax, " pages"));
}

absl::StatusOr<std::vector<SubmapInfo>> MapClient::ListSubmaps(const std::string& map) const {
  for (int tries = 0; tries < options_.consistent_tries_max; ++tries) {
    std::vector<SubmapInfo> submaps;
    std::optional<MapVersion> version;
    v1::ListSubmapsRequest request;
    request.set_map(map);
    request.set_page_size(kPageSize);
    for (int page = 0; page < kPagesMax; ++page) {
      v1::ListSubmapsResponse response;
      GEM_RETURN_IF_ERROR(stubs_->Call(*stubs_->map, &v1::MapService::Stub::ListSubmaps,
                                       options_.deadline_s, request, response));
      const MapVersion page_version = wire::FromProto(response.version());
      if (version.value_or(page_version) != page_version) break;
      version = page_version;
      for (const v1::Submap& proto : response.submaps()) {
        GEM_ASSIGN_OR_RETURN(SubmapInfo submap, FromProto(proto, wire::FieldPath("submaps")));
        submaps.push_back(std::move(submap));
      }
      if (response.next_page_token().empty()) return submaps;
      request.set_page_token(response.next_page_token());
    }
  }
  return NeverStillError(map, options_.consistent_tries_max);
}

absl::StatusOr<TileMatrix> MapClient::GetTileMatrix(const std::string& map) const {
  v1::GetTileMatrixRequest request;
  v1::GetTileMatrixResponse response;
  request.set_map(map);
  GEM_RETURN_IF_ERROR(stubs_->Call(*stubs_->tile, &v1::TileService::Stub::GetTileMatrix,
                                   options_.deadline_s, request, response));
  if (response.tile_cells() != kTileCells)
    return absl::InternalError(absl::StrCat("the server has tiles of ", response.tile_cells(),
                                            " cells a side, want ", kTileCells));
  if (!(response.cell_size_m() > 0 && response.cell_size_m() <= kCellSizeMax_m))
    return absl::InternalError(absl::StrCat("the server has cells of ", response.cell_size_m(),
                                            " m, want (0, ", kCellSizeMax_m, "]"));
  if (response.tiles_size() > kTilesMax)
    return absl::ResourceExhaustedError(absl::StrCat("map ", map, " has ", response.tiles_size(),
                                                     " tiles, this client takes at most ",
                                                     kTilesMax));
  TileMatrix matrix{response.cell_size_m(),
                    response.traversability_free(),
                    {},
                    wire::FromProto(response.version())};
  matrix.tiles.reserve(static_cast<std::size_t>(response.tiles_size()));
  for (const v1::TileKey& key : response.tiles()) {
    GEM_ASSIGN_OR_RETURN(const TileAddress tile, wire::FromProto(key, wire::FieldPath("tiles")));
    if (tile.level != 0)
      return absl::InternalError(absl::StrCat("the server lists a tile of level ", tile.level));
    matrix.tiles.push_back(tile.index);
  }
  return matrix;
}

absl::StatusOr<TileSet> MapClient::GetTilesOnce(const std::string& map,
                                                const std::vector<TileIndex>& tiles,
                                                const CellSelection& selection) const {
  TileSet set;
  set.tiles.reserve(tiles.size());
  while (set.tiles.size() < tiles.size()) {
    const std::size_t begin = set.tiles.size();
    const std::size_t end = std::min(begin + kTilesOfBatchMax, tiles.size());
    v1::BatchGetTilesRequest request;
    v1::BatchGetTilesResponse response;
    request.set_map(map);
    Select(selection, request);
    for (std::size_t i = begin; i < end; ++i)
      wire::ToProto(TileAddress{0, tiles[i]}, request.add_tiles());
    GEM_RETURN_IF_ERROR(stubs_->Call(*stubs_->tile, &v1::TileService::Stub::BatchGetTiles,
                                     options_.deadline_s, request, response));
    if (response.tiles_size() != static_cast<int>(end - begin))
      return absl::InternalError(absl::StrCat("the server sent ", response.tiles_size(),
                                              " tiles instead of ", end - begin));
    const MapVersion version = wire::FromProto(response.version());
    if (begin > 0 && version != set.version)
      return absl::AbortedError(absl::StrCat("map ", map, " changed"));
    set.version = version;
    for (const v1::Tile& proto : response.tiles()) {
      GEM_ASSIGN_OR_RETURN(wire::DecodedTile decoded,
                           wire::FromProto(proto, wire::FieldPath("tiles")));
      GEM_RETURN_IF_ERROR(CheckTile(decoded, {0, tiles[set.tiles.size()]}, selection));
      MapTile tile{decoded.address.index, decoded.version, std::move(decoded.grid)};
      set.tiles.push_back(std::move(tile));
    }
  }
  return set;
}

absl::StatusOr<TileSet> MapClient::GetTiles(const std::string& map,
                                            const std::vector<TileIndex>& tiles,
                                            const CellSelection& selection) const {
  for (int tries = 0; tries < options_.consistent_tries_max; ++tries) {
    absl::StatusOr<TileSet> set = GetTilesOnce(map, tiles, selection);
    if (!absl::IsAborted(set.status())) return set;
  }
  return NeverStillError(map, options_.consistent_tries_max);
}

absl::StatusOr<TiledMap> MapClient::ReadMap(const std::string& map,
                                            const std::optional<Region>& region,
                                            const CellSelection& selection) const {
  for (int tries = 0; tries < options_.consistent_tries_max; ++tries) {
    GEM_ASSIGN_OR_RETURN(TileMatrix matrix, GetTileMatrix(map));
    if (region)
      std::erase_if(matrix.tiles,
                    [&](TileIndex tile) { return !Touches(tile, *region, matrix.cell_size_m); });
    if (matrix.tiles.empty()) return TiledMap{matrix, {matrix.version, {}}};
    absl::StatusOr<TileSet> tiles = GetTilesOnce(map, matrix.tiles, selection);
    if (!tiles.ok() && !absl::IsAborted(tiles.status())) return tiles.status();
    // A newer version may have tiles that the matrix does not list.
    if (tiles.ok() && tiles->version == matrix.version)
      return TiledMap{std::move(matrix), *std::move(tiles)};
  }
  return NeverStillError(map, options_.consistent_tries_max);
}

absl::StatusOr<LocalMap> MapClient::GetLocalMap(const std::string& robot,
                                                const CellSelection& selection) const {
  v1::GetLocalMapRequest request;
  v1::GetLocalMapResponse response;
  request.set_robot(robot);
  Select(selection, request);
  GEM_RETURN_IF_ERROR(stubs_->Call(*stubs_->tile, &v1::TileService::Stub::GetLocalMap,
                                   options_.deadline_s, request, response));
  GEM_ASSIGN_OR_RETURN(wire::DecodedLocalMap decoded,
                       wire::FromProto(response.local_map(), wire::FieldPath("local_map")));
  for (const Layer layer : selection.layers)
    if (decoded.grid.Find(layer) == nullptr)
      return absl::InternalError(
          absl::StrCat("the server sent a local map without layer ", NameOf(layer)));
  return LocalMap{decoded.stamp_ns, decoded.seq,   decoded.origin,  std::move(decoded.grid),
                  decoded.T_O_B,    decoded.T_G_O, decoded.session, decoded.traversability_free};
}

absl::StatusOr<CorrectionResult> MapClient::CorrectTrajectory(const Correction& correction) const {
  v1::CorrectTrajectoryRequest request;
  wire::ToProto(
      {correction.map, correction.session,
       correction.request_id.empty() ? UniqueId() : correction.request_id, correction.poses},
      &request);
  absl::Status status;
  for (int tries = 0; tries < options_.correction_tries_max; ++tries) {
    if (tries > 0) std::this_thread::sleep_for(kCorrectionPause);
    v1::CorrectTrajectoryResponse response;
    status = stubs_->Call(*stubs_->ingest, &v1::IngestService::Stub::CorrectTrajectory,
                          options_.correction_deadline_s, request, response);
    if (status.ok())
      return CorrectionResult{wire::FromProto(response.version()), response.num_moved_submaps(),
                              response.num_touched_tiles(), response.num_poses_ahead(),
                              response.num_poses_ignored()};
    if (!absl::IsUnavailable(status)) break;
  }
  return status;
}

absl::StatusOr<ServerStatus> MapClient::GetServerStatus() const {
  const v1::GetServerStatusRequest request;
  v1::GetServerStatusResponse response;
  GEM_RETURN_IF_ERROR(stubs_->Call(*stubs_->map, &v1::MapService::Stub::GetServerStatus,
                                   options_.deadline_s, request, response));
  return FromProto(response);
}

std::string UniqueId() {
  std::random_device random;
  return absl::StrFormat("%08x%08x", random(), random());
}

}  // namespace gem::client
