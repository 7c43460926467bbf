// The messages of WatchTiles and StreamTiles: a watch decides which tiles, this encodes them.
#pragma once

#include <memory>
#include <string>

#include "proto/wire/tile_message.h"
#include "server/message_source.h"
#include "server/metrics.h"
#include "server/tile_encoder.h"
#include "server/tile_watch.h"

namespace gem {

class TileSource final : public MessageSource {
 public:
  struct Setup {
    wire::TileMessage::Kind kind = wire::TileMessage::Kind::kWatch;
    TileWatchOptions watch;
    wire::CellSelection cells;
    bool keys_only = false;
  };
  /// cache and metrics outlive the source.
  TileSource(std::shared_ptr<const MapHistory> history, const Setup& setup, EncodedCache& cache,
             Metrics& metrics);

  Next TakeNext(Clock::time_point now) override;
  std::optional<Clock::time_point> behind_since() const override { return watch_.behind_since(); }

 private:
  const wire::TileMessage::Kind kind_;
  const bool keys_only_;
  const TileEncoder encoder_;
  Metrics& metrics_;
  TileWatch watch_;
};

}  // namespace gem
