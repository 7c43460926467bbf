#include "server/tile_source.h"

#include <utility>

namespace gem {
namespace {

/// Writes the tiles of a part into a message.
class MessageSink final : public TileSink {
 public:
  MessageSink(wire::TileMessage::Kind kind, const TileEncoder& encoder, bool keys_only)
      : encoder_(encoder), keys_only_(keys_only), message_(kind) {}

  void Add(const Tile& tile) override {
    const EncodedCache::Encoded encoded = encoder_.Encode(tile);
    if (keys_only_) {
      message_.AddKeyOnly(tile, encoded->etag);
      ++counts_.key_only;
    } else {
      message_.Add(encoded);
      ++counts_.full;
    }
  }
  void AddAbsent(const TileAddress& address, const MapVersion& version) override {
    message_.AddAbsent(address, version);
    ++counts_.absent;
  }
  std::size_t size_bytes() const override { return message_.size_bytes(); }

  const TileCounts& counts() const { return counts_; }
  wire::SplicedMessage Finish(wire::TileMessage::Kind kind, const TileWatch::Turn& turn) && {
    if (kind == wire::TileMessage::Kind::kStream)
      return std::move(message_).FinishStream(turn.version, turn.reset, turn.complete);
    return std::move(message_).FinishWatch(
        {turn.base, turn.version, turn.reset, turn.complete, turn.num_versions_skipped});
  }

 private:
  const TileEncoder& encoder_;
  const bool keys_only_;
  wire::TileMessage message_;
  TileCounts counts_;
};

}  // namespace

TileSource::TileSource(std::shared_ptr<const MapHistory> history, const Setup& setup,
                       EncodedCache& cache, Metrics& metrics)
    : kind_(setup.kind),
      keys_only_(setup.keys_only),
      encoder_(cache, history->source(), history->newest()->options.cell_size_m, setup.cells),
      metrics_(metrics),
      watch_(std::move(history), setup.watch, Clock::now()) {}

MessageSource::Next TileSource::TakeNext(Clock::time_point now) {
  MessageSink sink(kind_, encoder_, keys_only_);
  const TileWatch::Turn turn = watch_.TakeTurn(now, sink);
  Next next;
  switch (turn.kind) {
    case TileWatch::Turn::Kind::kWait:
      next.wake_at = turn.wake_at;
      break;
    case TileWatch::Turn::Kind::kEnd:
      next.end = turn.status;
      break;
    case TileWatch::Turn::Kind::kPart:
      metrics_.CountTiles(sink.counts());
      metrics_.CountSkippedVersions(turn.num_versions_skipped);
      next.message = std::move(sink).Finish(kind_, turn);
      watch_.CountSent(next.message->size_bytes(), now);
      break;
  }
  return next;
}

}  // namespace gem
