// Published maps made by hand: a mapper that changes single tiles.
#pragma once

#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "core/global/map_snapshot.h"
#include "server/ingest_message.h"

namespace gem::test {

inline constexpr std::uint64_t kEpoch = 7;

inline Clock::time_point AtSeconds(double seconds) {
  return Clock::time_point(std::chrono::nanoseconds(static_cast<std::int64_t>(seconds * 1e9)));
}

/// Snapshots one after the other, of cells of 1 m: tiles are 128 m wide at level 0.
class MadeMaps {
 public:
  explicit MadeMaps(std::uint64_t epoch = kEpoch) : version_{epoch, 0} {}

  std::shared_ptr<const MapSnapshot> Next(const std::vector<TileIndex>& changed,
                                          const std::vector<TileIndex>& gone = {}, int level = 0) {
    ++version_.revision;
    TileMap& tiles = levels_[static_cast<std::size_t>(level)];
    for (const TileIndex index : changed) {
      auto tile = std::make_shared<Tile>();
      tile->level = level;
      tile->index = index;
      tile->version = version_;
      tile->cells.resize(kTileCells * kTileCells);
      // What tells revisions apart for those who look at cells.
      tile->cells[0] = {static_cast<float>(version_.revision), 0.01f, 0, 0, 1, kCellKnown};
      tiles[index] = std::move(tile);
    }
    for (const TileIndex index : gone) tiles.erase(index);
    return Current();
  }

  std::shared_ptr<const MapSnapshot> Current() const {
    auto snapshot = std::make_shared<MapSnapshot>();
    snapshot->version = version_;
    snapshot->options.cell_size_m = 1;
    snapshot->tiles = levels_[0];
    for (std::size_t level = 1; level < levels_.size(); ++level)
      snapshot->coarser[level - 1] = levels_[level];
    return snapshot;
  }

 private:
  MapVersion version_;
  std::array<TileMap, kLevelMax + 1> levels_;
};

}  // namespace gem::test
