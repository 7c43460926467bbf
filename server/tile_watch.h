// What one reader of a map still has to hear: the tiles of a region, then whatever changes, in
// parts. Holds no snapshot, only addresses that are due and versions, so that a reader that never
// reads costs no memory. Not thread-safe, and knows nothing of the wire.
#pragma once

#include <atomic>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <vector>

#include "absl/status/status.h"
#include "core/global/map_snapshot.h"
#include "core/grid/region.h"
#include "server/ingest_message.h"
#include "server/map_history.h"

namespace gem {

struct TileWatchOptions {
  int level = 0;
  std::optional<Region> region = {};     ///< nothing: the whole map
  std::optional<Place> nearest_to = {};  ///< nothing: the middle of the region, or of the map
  std::optional<MapVersion> since = {};  ///< what the reader has already
  bool once = false;                  ///< ends after one change, and never turns to another version
  double min_interval_s = 0;          ///< between the beginnings of two changes
  std::uint64_t bytes_per_s_max = 0;  ///< on average; 0: no limit
};

/// Takes the tiles of a part.
class TileSink {
 public:
  virtual ~TileSink() = default;
  virtual void Add(const Tile& tile) = 0;
  virtual void AddAbsent(const TileAddress& address, const MapVersion& version) = 0;
  /// Of what was added so far.
  virtual std::size_t size_bytes() const = 0;
};

class TileWatch {
 public:
  /// A part is closed when it has so many bytes, or so many tiles with cells: what one turn of a
  /// worker costs, and what a reader that does not read holds.
  static constexpr std::size_t kPartBytes = 64u << 10;
  static constexpr int kTilesOfPart_max = 16;

  TileWatch(std::shared_ptr<const MapHistory> history, const TileWatchOptions& options,
            Clock::time_point now);

  /// What to do now.
  struct Turn {
    enum class Kind : std::uint8_t { kPart, kWait, kEnd };
    Kind kind = Kind::kWait;

    // kPart: the sink has its tiles.
    std::optional<MapVersion> base;  ///< nothing with reset
    MapVersion version;
    bool reset = false;
    bool complete = false;
    std::uint64_t num_versions_skipped = 0;

    /// kWait: until then, or for news if there is none.
    std::optional<Clock::time_point> wake_at;
    /// kEnd: OK after a change of a watch that wants one only; NOT_FOUND when the map is gone;
    /// FAILED_PRECONDITION, reason REVISION_EXPIRED, if that one change took too long.
    absl::Status status;
  };
  Turn TakeTurn(Clock::time_point now, TileSink& sink);
  /// The part of the last turn occupies so many bytes on the wire.
  void CountSent(std::size_t bytes, Clock::time_point now);

  /// Since when the reader lacks something that is published, not counting the interval that it
  /// asked for; nothing: it has everything. Thread-safe.
  std::optional<Clock::time_point> behind_since() const;

 private:
  static constexpr std::uint64_t kNone = std::numeric_limits<std::uint64_t>::max();

  /// On the way from one complete version to the next.
  struct Change {
    MapVersion target;
    bool reset = false;
    bool reset_told = false;
    std::vector<TileIndex> due;  ///< the next one last
  };

  std::shared_ptr<const MapSnapshot> Begin(Clock::time_point now);
  /// The version that tiles are read from is not kept any more: goes on with the newest.
  std::shared_ptr<const MapSnapshot> Retarget();
  Turn MakePart(const MapSnapshot& snapshot, TileSink& sink);
  void SortByDistance(std::vector<TileIndex>& tiles, double cell_size_m) const;

  // Constant after construction.
  const std::shared_ptr<const MapHistory> history_;
  const TileWatchOptions options_;
  const std::optional<TileRange> range_;
  const std::size_t part_bytes_;
  const Clock::time_point created_;

  std::optional<MapVersion> base_;  ///< what the reader has completely
  std::optional<Change> change_;
  bool told_any_ = false;  ///< a part was made
  bool done_ = false;
  Clock::time_point next_change_at_;
  Clock::time_point next_part_at_;

  // For behind_since().
  std::atomic<std::uint64_t> complete_revision_{kNone};  ///< that this watch has told
  std::atomic<Clock::rep> next_change_ticks_{0};         ///< next_change_at_
};

}  // namespace gem
