#include "proto/wire/tile_message.h"

#define XXH_STATIC_LINKING_ONLY  // its state may live on the stack
#include <xxhash.h>

#include <type_traits>
#include <utility>

#include "absl/strings/string_view.h"
#include "core/base/check.h"
#include "gem/v1/tile_service.pb.h"
#include "gem/v1/types.pb.h"
#include "proto/wire/map.h"

namespace gem::wire {
namespace {

/// XXH3 of values of fixed width and of strings with their length: two different sequences of the
/// same types never feed it the same bytes.
class Hash {
 public:
  Hash() { XXH3_64bits_reset(&state_); }

  template <typename T>
  void Add(T value) {
    static_assert(std::is_arithmetic_v<T>);
    XXH3_64bits_update(&state_, &value, sizeof(value));
  }
  void Add(const std::string& value) {
    Add(static_cast<std::uint64_t>(value.size()));
    XXH3_64bits_update(&state_, value.data(), value.size());
  }
  std::uint64_t digest() const { return XXH3_64bits_digest(&state_); }

 private:
  XXH3_state_t state_;
};

void AddLayer(const v1::GridLayer& layer, Hash& hash) {
  hash.Add(static_cast<int>(layer.layer()));
  hash.Add(static_cast<int>(layer.type()));
  hash.Add(layer.scale());
  hash.Add(layer.offset());
  hash.Add(static_cast<int>(layer.predictor()));
  hash.Add(layer.zstd());
  hash.Add(layer.valid_bitmap());
  hash.Add(layer.data());
}

std::uint64_t EtagOf(const v1::Tile& tile, CellEncoding encoding) {
  Hash hash;
  hash.Add(tile.key().level());
  hash.Add(tile.key().x());
  hash.Add(tile.key().y());
  hash.Add(static_cast<int>(encoding));
  hash.Add(tile.grid().cell_size_m());
  for (const v1::GridLayer& layer : tile.grid().layers()) {
    AddLayer(layer, hash);
    // Ages mean nothing without what they count back from; nothing else needs it.
    if (layer.layer() == v1::LAYER_AGE) hash.Add(std::int64_t{tile.grid().stamp_ns()});
  }
  const std::uint64_t digest = hash.digest();
  return digest == 0 ? 1 : digest;
}

void SetKey(const Tile& tile, std::uint64_t etag, v1::Tile* proto) {
  ToProto(AddressOf(tile), proto->mutable_key());
  ToProto(tile.version, proto->mutable_version());
  proto->set_etag(etag);
}

}  // namespace

EncodedCells EncodeTile(const Tile& tile, float cell_size_m, std::span<const Layer> layers,
                        CellEncoding encoding) {
  v1::Tile proto;
  ToProto(tile, cell_size_m, layers, encoding, &proto);
  const std::uint64_t etag = EtagOf(proto, encoding);
  proto.set_etag(etag);
  return {proto.SerializeAsString(), etag};
}

void TileMessage::Add(const std::shared_ptr<const EncodedCells>& tile) {
  message_.AppendShared(TilesField(), {tile, &tile->bytes});
}

void TileMessage::AddNotModified(const Tile& tile, std::uint64_t etag) {
  v1::Tile proto;
  SetKey(tile, etag, &proto);
  proto.set_not_modified(true);
  message_.AppendField(TilesField(), proto.SerializeAsString());
}

void TileMessage::AddKeyOnly(const Tile& tile, std::uint64_t etag) {
  v1::Tile proto;
  SetKey(tile, etag, &proto);
  message_.AppendField(TilesField(), proto.SerializeAsString());
}

void TileMessage::AddAbsent(const TileAddress& address, const MapVersion& version) {
  v1::Tile proto;
  ToProto(address, proto.mutable_key());
  ToProto(version, proto.mutable_version());
  proto.set_absent(true);
  message_.AppendField(TilesField(), proto.SerializeAsString());
}

int TileMessage::TilesField() const {
  switch (kind_) {
    case Kind::kBatch:
      return v1::BatchGetTilesResponse::kTilesFieldNumber;
    case Kind::kStream:
      return v1::StreamTilesResponse::kTilesFieldNumber;
    case Kind::kWatch:
      return v1::WatchTilesResponse::kTilesFieldNumber;
  }
  GEM_CHECK(false);
  return 0;
}

// The order of fields on the wire is free: what is known last comes last.
SplicedMessage TileMessage::FinishBatch(const MapVersion& version) && {
  GEM_CHECK(kind_ == Kind::kBatch);
  v1::BatchGetTilesResponse rest;
  ToProto(version, rest.mutable_version());
  message_.Append(rest.SerializeAsString());
  return std::move(message_);
}

SplicedMessage TileMessage::FinishStream(const MapVersion& version, bool reset, bool complete) && {
  GEM_CHECK(kind_ == Kind::kStream);
  v1::StreamTilesResponse rest;
  ToProto(version, rest.mutable_version());
  rest.set_reset(reset);
  rest.set_complete(complete);
  message_.Append(rest.SerializeAsString());
  return std::move(message_);
}

SplicedMessage TileMessage::FinishWatch(const WatchEnd& end) && {
  GEM_CHECK(kind_ == Kind::kWatch);
  v1::WatchTilesResponse rest;
  if (end.base.has_value()) ToProto(*end.base, rest.mutable_base());
  ToProto(end.version, rest.mutable_version());
  rest.set_reset(end.reset);
  rest.set_complete(end.complete);
  rest.set_num_versions_skipped(end.num_versions_skipped);
  message_.Append(rest.SerializeAsString());
  return std::move(message_);
}

}  // namespace gem::wire
