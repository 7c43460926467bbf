#include "server/tile_service.h"

#include <algorithm>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "core/base/status_macros.h"
#include "proto/wire/local_map_message.h"
#include "proto/wire/map.h"
#include "proto/wire/refusal.h"
#include "proto/wire/tile_message.h"
#include "proto/wire/tile_request.h"
#include "server/byte_buffer.h"
#include "server/find_snapshot.h"
#include "server/local_map_source.h"
#include "server/tile_source.h"

namespace gem {
namespace {

absl::Status GetTileMatrix(const Registry& registry, const v1::GetTileMatrixRequest& proto,
                           v1::GetTileMatrixResponse* response) {
  GEM_ASSIGN_OR_RETURN(const wire::TileMatrixRequest request, wire::FromProto(proto));
  const auto snapshot = FindSnapshot(registry, request.map, std::nullopt);
  if (!snapshot.ok()) return snapshot.status();
  const MapSnapshot& map = **snapshot;
  response->set_cell_size_m(map.options.cell_size_m);
  response->set_tile_cells(kTileCells);
  response->set_traversability_free(map.options.traversability_free);
  response->set_max_level(kLevelMax);
  for (const Layer layer : wire::TileLayers())
    response->add_layers(static_cast<v1::Layer>(wire::ToProto(layer)));
  const TileMap& of_level = map.TilesOf(request.level);
  std::vector<TileIndex> tiles;
  tiles.reserve(of_level.size());
  for (const auto& [index, tile] : of_level) tiles.push_back(index);
  std::sort(tiles.begin(), tiles.end(),
            [](TileIndex a, TileIndex b) { return a.y != b.y ? a.y < b.y : a.x < b.x; });
  for (const TileIndex tile : tiles)
    wire::ToProto(TileAddress{request.level, tile}, response->add_tiles());
  wire::ToProto(map.version, response->mutable_version());
  return absl::OkStatus();
}

/// One tile of an answer; if_none_match: 0 for none.
void AddTile(const MapSnapshot& map, const TileAddress& address, std::uint64_t if_none_match,
             const TileEncoder& encoder, wire::TileMessage& message, TileCounts& counts) {
  const TileMap& tiles = map.TilesOf(address.level);
  const auto tile = tiles.find(address.index);
  if (tile == tiles.end()) {
    message.AddAbsent(address, map.version);
    ++counts.absent;
    return;
  }
  const EncodedCache::Encoded encoded = encoder.Encode(*tile->second);
  if (encoded->etag == if_none_match) {
    message.AddNotModified(*tile->second, encoded->etag);
    ++counts.not_modified;
  } else {
    message.Add(encoded);
    ++counts.full;
  }
}

absl::StatusOr<wire::SplicedMessage> BatchGetTiles(const Registry& registry, EncodedCache& cache,
                                                   Metrics& metrics,
                                                   const v1::BatchGetTilesRequest& proto) {
  GEM_ASSIGN_OR_RETURN(const wire::BatchRequest request, wire::FromProto(proto));
  const absl::StatusOr<std::shared_ptr<MapActor>> map = registry.FindMap(request.map);
  if (!map.ok()) return map.status();
  const auto snapshot = FindSnapshot(**map, request.at);
  if (!snapshot.ok()) return snapshot.status();
  const TileEncoder encoder(cache, (*map)->history()->source(), (*snapshot)->options.cell_size_m,
                            request.cells);
  wire::TileMessage message(wire::TileMessage::Kind::kBatch);
  TileCounts counts;
  for (std::size_t i = 0; i < request.tiles.size(); ++i)
    AddTile(**snapshot, request.tiles[i],
            request.if_none_match.empty() ? 0 : request.if_none_match[i], encoder, message, counts);
  metrics.CountTiles(counts);
  return std::move(message).FinishBatch((*snapshot)->version);
}

absl::StatusOr<wire::SplicedMessage> GetLocalMap(const Registry& registry, EncodedCache& cache,
                                                 const v1::GetLocalMapRequest& proto) {
  GEM_ASSIGN_OR_RETURN(const wire::LocalMapRequest request, wire::FromProto(proto));
  const auto feed = registry.FindLocalMaps(request.robot);
  if (!feed.ok()) return feed.status();
  const LocalMapFeed::Newest newest = (*feed)->newest();
  if (newest.map == nullptr)
    return wire::WithField(
        absl::NotFoundError(absl::StrCat("robot is ", request.robot,
                                         ", of which no scan is fused yet, want one with a map")),
        "robot");
  return wire::GetLocalMapMessage(
      *newest.map, ContextOf(*newest.origin),
      EncodeGrid(cache, (*feed)->source(), newest.number, *newest.map, request.cells));
}

/// Parses, answers, and hands the answer over; the messages live until the call is completed.
template <typename Request, typename Answer>
absl::Status AnswerWithBytes(const grpc::ByteBuffer& bytes, Answer answer,
                             grpc::ByteBuffer* response) {
  GEM_ASSIGN_OR_RETURN(const Request request, Parse<Request>(bytes));
  GEM_ASSIGN_OR_RETURN(const wire::SplicedMessage message, answer(request));
  *response = ToByteBuffer(message);
  return absl::OkStatus();
}

}  // namespace

TileService::TileService(Registry& registry, EncodedCache& cache, TurnScheduler& readers,
                         Metrics& metrics, CallGuard& guard)
    : registry_(registry),
      cache_(cache),
      readers_(readers),
      metrics_(metrics),
      guard_(guard),
      get_tile_matrix_(metrics.AddMethod("GetTileMatrix")),
      batch_get_tiles_(metrics.AddMethod("BatchGetTiles")),
      stream_tiles_(metrics.AddMethod("StreamTiles")),
      watch_tiles_(metrics.AddMethod("WatchTiles")),
      get_local_map_(metrics.AddMethod("GetLocalMap")),
      watch_local_map_(metrics.AddMethod("WatchLocalMap")) {}

grpc::ServerUnaryReactor* TileService::GetTileMatrix(grpc::CallbackServerContext* context,
                                                     const v1::GetTileMatrixRequest* request,
                                                     v1::GetTileMatrixResponse* response) {
  return guard_.RunInPool(context, {request, response}, get_tile_matrix_,
                          [=, this] { return gem::GetTileMatrix(registry_, *request, response); });
}

grpc::ServerUnaryReactor* TileService::BatchGetTiles(grpc::CallbackServerContext* context,
                                                     const grpc::ByteBuffer* request,
                                                     grpc::ByteBuffer* response) {
  return guard_.RunInPool(context, {request, response}, batch_get_tiles_, [=, this] {
    return AnswerWithBytes<v1::BatchGetTilesRequest>(
        *request,
        [this](const auto& parsed) {
          return gem::BatchGetTiles(registry_, cache_, metrics_, parsed);
        },
        response);
  });
}

grpc::ServerUnaryReactor* TileService::GetLocalMap(grpc::CallbackServerContext* context,
                                                   const grpc::ByteBuffer* request,
                                                   grpc::ByteBuffer* response) {
  return guard_.RunInPool(context, {request, response}, get_local_map_, [=, this] {
    return AnswerWithBytes<v1::GetLocalMapRequest>(
        *request,
        [this](const auto& parsed) { return gem::GetLocalMap(registry_, cache_, parsed); },
        response);
  });
}

grpc::ServerWriteReactor<grpc::ByteBuffer>* TileService::StreamTiles(
    grpc::CallbackServerContext* /*context*/, const grpc::ByteBuffer* request) {
  return StartStream<v1::StreamTilesRequest>(*request, stream_tiles_);
}

grpc::ServerWriteReactor<grpc::ByteBuffer>* TileService::WatchTiles(
    grpc::CallbackServerContext* /*context*/, const grpc::ByteBuffer* request) {
  return StartStream<v1::WatchTilesRequest>(*request, watch_tiles_);
}

grpc::ServerWriteReactor<grpc::ByteBuffer>* TileService::WatchLocalMap(
    grpc::CallbackServerContext* /*context*/, const grpc::ByteBuffer* request) {
  return StartStream<v1::WatchLocalMapRequest>(*request, watch_local_map_);
}

template <typename Request>
ReaderStream* TileService::StartStream(const grpc::ByteBuffer& request, MethodMetrics& metrics) {
  const auto stream = std::make_shared<ReaderStream>(readers_, metrics);
  absl::StatusOr<Request> parsed = Parse<Request>(request);
  absl::StatusOr<Opening> opening = parsed.ok() ? Open(*parsed) : parsed.status();
  if (opening.ok()) {
    stream->Start(request.Length(), std::move(opening->source), opening->news);
  } else {
    stream->Refuse(request.Length(), opening.status());
  }
  return stream.get();  // keeps itself alive
}

absl::StatusOr<TileService::Opening> TileService::Open(const v1::StreamTilesRequest& proto) {
  GEM_ASSIGN_OR_RETURN(wire::StreamRequest request, wire::FromProto(proto));
  const absl::StatusOr<std::shared_ptr<MapActor>> map = registry_.FindMap(request.map);
  if (!map.ok()) return map.status();
  TileSource::Setup setup;
  setup.kind = wire::TileMessage::Kind::kStream;
  setup.watch.level = request.level;
  setup.watch.region = request.region;
  setup.watch.nearest_to = request.nearest_to;
  setup.watch.since = request.changed_after;
  setup.watch.once = true;
  setup.cells = std::move(request.cells);
  const std::shared_ptr<MapHistory>& history = (*map)->history();
  return Opening{std::make_unique<TileSource>(history, setup, cache_, metrics_), history->source()};
}

absl::StatusOr<TileService::Opening> TileService::Open(const v1::WatchTilesRequest& proto) {
  GEM_ASSIGN_OR_RETURN(wire::WatchRequest request, wire::FromProto(proto));
  const absl::StatusOr<std::shared_ptr<MapActor>> map = registry_.FindMap(request.map);
  if (!map.ok()) return map.status();
  TileSource::Setup setup;
  setup.kind = wire::TileMessage::Kind::kWatch;
  setup.watch.level = request.level;
  setup.watch.region = request.region;
  setup.watch.since = request.resume_from;
  setup.watch.min_interval_s = request.min_interval_s;
  setup.watch.bytes_per_s_max = request.bytes_per_s_max;
  setup.cells = std::move(request.cells);
  setup.keys_only = request.keys_only;
  const std::shared_ptr<MapHistory>& history = (*map)->history();
  return Opening{std::make_unique<TileSource>(history, setup, cache_, metrics_), history->source()};
}

absl::StatusOr<TileService::Opening> TileService::Open(const v1::WatchLocalMapRequest& proto) {
  GEM_ASSIGN_OR_RETURN(wire::LocalMapRequest request, wire::FromProto(proto));
  absl::StatusOr<std::shared_ptr<const LocalMapFeed>> feed = registry_.FindLocalMaps(request.robot);
  if (!feed.ok()) return feed.status();
  const NewsSource news = (*feed)->source();
  return Opening{std::make_unique<LocalMapSource>(*std::move(feed), std::move(request.cells),
                                                  request.min_interval_s, cache_, metrics_),
                 news};
}

}  // namespace gem
