#include "tests/fuzz/reader_messages.h"

#include <google/protobuf/stubs/logging.h>

#include <array>
#include <cmath>
#include <string_view>

#include "client/calls/decode_tile.h"
#include "client/mirror_store.h"
#include "core/base/check.h"
#include "gem/v1/terrain_service.pb.h"
#include "gem/v1/tile_service.pb.h"
#include "proto/wire/map.h"
#include "proto/wire/refusal.h"
#include "proto/wire/terrain.h"
#include "proto/wire/tile_request.h"
#include "tests/fuzz/framed_messages.h"

namespace gem::fuzz {
namespace {

constexpr std::size_t kMirroredTilesMax = 3;
constexpr MapVersion kVersion = {7, 3};

const client::CellSelection kCells = {{Layer::kElevation}, client::CellEncoding::kCompact};

template <typename T>
void CheckJudged(const absl::StatusOr<T>& judged) {
  // A refusal names its field: planners show it to people.
  GEM_CHECK(judged.ok() || !wire::FieldOf(judged.status()).empty());
}

template <typename Message>
bool Parse(std::string_view bytes, Message& message) {
  return message.ParseFromArray(bytes.data(), static_cast<int>(bytes.size()));
}

void CheckPathRequestOf(std::string_view bytes) {
  v1::CheckPathRequest message;
  if (!Parse(bytes, message)) return;
  const auto question = wire::FromProto(message);
  CheckJudged(question);
  if (!question.ok()) return;
  for (const Place& corner : question->path)
    GEM_CHECK(std::isfinite(corner.x_m) && std::isfinite(corner.y_m));
}

void SampleHeightsRequestOf(std::string_view bytes) {
  v1::SampleHeightsRequest message;
  if (Parse(bytes, message)) CheckJudged(wire::PointsFromProto(message));
}

template <typename Message>
void RequestOf(std::string_view bytes) {
  Message message;
  if (Parse(bytes, message)) CheckJudged(wire::FromProto(message));
}

constexpr std::array<void (*)(std::string_view), 8> kRequests = {
    SampleHeightsRequestOf,
    CheckPathRequestOf,
    RequestOf<v1::GetTileMatrixRequest>,
    RequestOf<v1::BatchGetTilesRequest>,
    RequestOf<v1::StreamTilesRequest>,
    RequestOf<v1::WatchTilesRequest>,
    RequestOf<v1::GetLocalMapRequest>,
    RequestOf<v1::WatchLocalMapRequest>};

void SampleHeightsAnswer(std::string_view bytes) {
  v1::SampleHeightsResponse message;
  if (!Parse(bytes, message)) return;
  const auto num_points = static_cast<std::size_t>(message.samples_size());
  GEM_CHECK(!wire::FromProto(message, num_points + 1).ok());
  const auto samples = wire::FromProto(message, num_points);
  if (!samples.ok()) return;
  for (const GroundSample& sample : *samples) GEM_CHECK(std::isfinite(sample.elevation_m));
}

void CheckPathAnswer(std::string_view bytes) {
  v1::CheckPathResponse message;
  if (!Parse(bytes, message)) return;
  const auto check = wire::FromProto(message);
  GEM_CHECK(!check.ok() || !check->samples.empty());
}

void TileMatrixAnswer(std::string_view bytes) {
  v1::GetTileMatrixResponse message;
  if (!Parse(bytes, message)) return;
  const auto matrix = client::DecodeTileMatrix(message, 0);
  GEM_CHECK(!matrix.ok() || matrix->cell_size_m > 0);
}

void LocalMapAnswer(std::string_view bytes) {
  v1::LocalMap message;
  if (!Parse(bytes, message)) return;
  const auto map = client::DecodeLocalMap(message, kCells);
  GEM_CHECK(!map.ok() || map->grid.Find(Layer::kElevation) != nullptr);
}

constexpr std::array<void (*)(std::string_view), 4> kAnswers = {
    SampleHeightsAnswer, CheckPathAnswer, TileMatrixAnswer, LocalMapAnswer};

void Choose(const auto& choices, const std::uint8_t* data, std::size_t size) {
  google::protobuf::SetLogHandler(nullptr);
  if (size == 0) return;
  choices[data[0] % choices.size()]({reinterpret_cast<const char*>(data) + 1, size - 1});
}

std::string Chosen(std::size_t choice, const google::protobuf::Message& message) {
  return static_cast<char>(choice) + message.SerializeAsString();
}

void CheckMirrored(const client::MirroredMap& map) {
  GEM_CHECK(map.tiles.size() <= kMirroredTilesMax);
  for (const auto& [index, tile] : map.tiles) {
    GEM_CHECK(tile.index == index && tile.grid != nullptr);
    GEM_CHECK(tile.grid->columns == kTileCells && tile.grid->rows == kTileCells);
    GEM_CHECK(tile.grid->Find(Layer::kElevation) != nullptr);
  }
  (void)map.IsFree({0, 0});
}

v1::Tile OneTile(TileIndex index) {
  gem::Tile tile{0, index, kVersion, std::vector<CellBelief>(kTileCells * kTileCells)};
  tile.cells[5] = {1.5f, 0.01f, 0.9f, 0, 1'000'000'000, kCellKnown | kCellAnnotated};
  v1::Tile proto;
  wire::ToProto(tile, 0.2f, std::array{Layer::kElevation}, wire::CellEncoding::kCompact, &proto);
  proto.set_etag(static_cast<std::uint64_t>(index.x) + 1);
  return proto;
}

/// Of a change that is complete.
v1::WatchTilesResponse Part(const std::vector<v1::Tile>& tiles, std::uint64_t revision) {
  v1::WatchTilesResponse part;
  for (const v1::Tile& tile : tiles) *part.add_tiles() = tile;
  wire::ToProto(MapVersion{kVersion.epoch, revision}, part.mutable_version());
  part.set_complete(true);
  return part;
}

}  // namespace

void ReaderRequest(const std::uint8_t* data, std::size_t size) { Choose(kRequests, data, size); }

void ReaderAnswer(const std::uint8_t* data, std::size_t size) { Choose(kAnswers, data, size); }

void Mirror(const std::uint8_t* data, std::size_t size) {
  google::protobuf::SetLogHandler(nullptr);
  client::MirrorStore store(kMirroredTilesMax);
  store.SetGeometry({0, 0.2, 0.5f, kVersion.epoch});
  for (const std::string_view bytes : FramedMessages({reinterpret_cast<const char*>(data), size})) {
    v1::WatchTilesResponse message;
    if (!Parse(bytes, message)) return;
    auto part = client::DecodePart(message, 0, kCells);
    // What cannot be used ends a stream; the next one goes on with what is held.
    const bool taken = part.ok() && store.Take(*std::move(part)).ok();
    if (!taken) store.DropParts();
    if (const auto map = store.snapshot()) CheckMirrored(*map);
  }
}

std::vector<std::string> ReaderRequestSeeds() {
  v1::SampleHeightsRequest sample;
  sample.set_map("site");
  wire::ToProto({{1, 2}, {-3, 4}}, &sample);
  v1::CheckPathRequest disc, rectangle;
  disc.set_map("site");
  wire::ToProto(PathQuestion{{{0, 0}, {3, 4}}, Disc{0.5}, 0.2}, &disc);
  rectangle.set_map("site");
  wire::ToProto(PathQuestion{{{0, 0}, {3, 4}, {3, 0}}, Rectangle{-0.5, -0.3, 0.5, 0.3}, 0},
                &rectangle);
  v1::GetTileMatrixRequest matrix;
  matrix.set_map("site");
  matrix.set_level(1);
  v1::BatchGetTilesRequest batch;
  batch.set_map("site");
  wire::ToProto(TileAddress{1, {-1, 2}}, batch.add_tiles());
  batch.add_layers(v1::LAYER_VARIANCE);
  batch.add_if_none_match(5);
  wire::ToProto(kVersion, batch.mutable_at());
  v1::StreamTilesRequest stream;
  stream.set_map("site");
  stream.mutable_region()->set_x_max(10);
  stream.mutable_region()->set_y_max(10);
  stream.mutable_nearest_to()->set_x(3);
  v1::WatchTilesRequest watch;
  watch.set_map("site");
  *watch.mutable_region() = stream.region();
  wire::ToProto(kVersion, watch.mutable_resume_from());
  watch.set_min_interval_s(0.5);
  watch.set_bytes_per_s_max(4096);
  v1::GetLocalMapRequest local;
  local.set_robot("robot");
  v1::WatchLocalMapRequest watch_local;
  watch_local.set_robot("robot");
  watch_local.set_min_interval_s(1);
  return {Chosen(0, sample), Chosen(1, disc),  Chosen(1, rectangle),
          Chosen(2, matrix), Chosen(3, batch), Chosen(4, stream),
          Chosen(5, watch),  Chosen(6, local), Chosen(7, watch_local)};
}

std::vector<std::string> ReaderAnswerSeeds() {
  const GroundSample ground{GroundState::kFree, 1.5f, 0.01f, 0.9f, 0.1f};
  v1::SampleHeightsResponse samples;
  wire::ToProto(std::vector<GroundSample>{ground, {}}, &samples);
  v1::CheckPathResponse path;
  PathCheck check;
  check.samples.push_back({});
  check.samples.back().ground = ground;
  wire::ToProto(check, &path);
  v1::GetTileMatrixResponse matrix;
  matrix.set_cell_size_m(0.2);
  matrix.set_tile_cells(kTileCells);
  matrix.set_max_level(kLevelMax);
  wire::ToProto(TileAddress{0, {-1, 2}}, matrix.add_tiles());
  v1::LocalMap local;
  local.set_session("session");
  *local.mutable_grid() = OneTile({0, 0}).grid();
  local.mutable_odom_from_base()->set_qw(1);
  local.mutable_map_from_odom()->set_qw(1);
  return {Chosen(0, samples), Chosen(1, path), Chosen(2, matrix), Chosen(3, local)};
}

std::vector<std::string> MirrorSeeds() {
  v1::WatchTilesResponse snapshot = Part({OneTile({0, 0}), OneTile({1, 0})}, 3);
  snapshot.set_reset(true);
  v1::Tile gone;
  wire::ToProto(TileAddress{0, {0, 0}}, gone.mutable_key());
  gone.set_absent(true);
  v1::WatchTilesResponse begun = Part({OneTile({2, 0})}, 4);
  wire::ToProto(kVersion, begun.mutable_base());
  begun.set_complete(false);
  v1::WatchTilesResponse ended = Part({gone}, 4);
  wire::ToProto(kVersion, ended.mutable_base());
  const auto framed = [](const std::vector<v1::WatchTilesResponse>& parts) {
    std::vector<std::string> messages;
    for (const auto& part : parts) messages.push_back(part.SerializeAsString());
    return Frame(messages);
  };
  return {framed({snapshot}), framed({snapshot, begun, ended}),
          framed({snapshot, begun, snapshot})};
}

}  // namespace gem::fuzz
