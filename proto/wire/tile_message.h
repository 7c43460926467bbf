// Answers with tiles (BatchGetTiles, StreamTiles, WatchTiles), put together from tiles that were
// encoded once and are shared between answers.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include "core/global/map_snapshot.h"
#include "core/grid/cell_index.h"
#include "core/grid/layered_grid.h"
#include "proto/wire/grid.h"
#include "proto/wire/spliced_message.h"

namespace gem::wire {

/// Serialised cells: a gem.v1.Tile, or the gem.v1.Grid of a local map, which has no etag.
struct EncodedCells {
  std::string bytes;
  std::uint64_t etag = 0;
};

/// The bytes depend on the arguments alone. The etag depends on address, layers, encoding and what
/// a client can see of the cells, not on versions; it is never 0. cell_size_m: at level 0.
EncodedCells EncodeTile(const Tile& tile, float cell_size_m, std::span<const Layer> layers,
                        CellEncoding encoding);

/// Gathers tiles; the kind of the answer says how it ends.
class TileMessage {
 public:
  enum class Kind : std::uint8_t { kBatch, kStream, kWatch };
  explicit TileMessage(Kind kind) : kind_(kind) {}

  void Add(const std::shared_ptr<const EncodedCells>& tile);
  /// The client holds it already.
  void AddNotModified(const Tile& tile, std::uint64_t etag);
  /// Neither cells nor absent.
  void AddKeyOnly(const Tile& tile, std::uint64_t etag);
  /// version: of the map, which knows no cell there.
  void AddAbsent(const TileAddress& address, const MapVersion& version);

  std::size_t size_bytes() const { return message_.size_bytes(); }

  /// gem.v1.BatchGetTilesResponse.
  SplicedMessage FinishBatch(const MapVersion& version) &&;
  /// gem.v1.StreamTilesResponse.
  SplicedMessage FinishStream(const MapVersion& version, bool reset, bool complete) &&;
  /// gem.v1.WatchTilesResponse.
  struct WatchEnd {
    std::optional<MapVersion> base;  ///< nothing with reset
    MapVersion version;
    bool reset = false;
    bool complete = false;
    std::uint64_t num_versions_skipped = 0;
  };
  SplicedMessage FinishWatch(const WatchEnd& end) &&;

 private:
  int TilesField() const;

  const Kind kind_;
  SplicedMessage message_;
};

}  // namespace gem::wire
