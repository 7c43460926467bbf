// The recent past of one map: snapshots that readers may still ask for, and which tiles went when.
// Knows nothing of who reads. Thread-safe; nobody waits for anybody's work.
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <vector>

#include "absl/container/flat_hash_map.h"
#include "absl/status/statusor.h"
#include "core/base/mutex.h"
#include "core/global/map_snapshot.h"
#include "server/ingest_message.h"
#include "server/news.h"

namespace gem {

struct HistoryOptions {
  double retention_s = 30;                ///< from when a newer revision replaced it
  std::uint64_t bytes_max = 256u << 20;   ///< of what only replaced revisions hold
  std::size_t tombstones_max = 1u << 16;  ///< addresses of tiles that went
  NewsListener* listener = nullptr;       ///< outlives the history; may be null
};

/// What a reader of some tiles must hear to get from one version to the newest.
struct TileChanges {
  std::shared_ptr<const MapSnapshot> snapshot;  ///< the newest
  /// The reader forgets what it holds: the version it has is none of this map's, or too old.
  bool reset = false;
  /// Addresses that changed or, where the snapshot has no tile, went; all tiles with reset. No
  /// order.
  std::vector<TileIndex> tiles;
};

class MapHistory {
 public:
  MapHistory(std::shared_ptr<const MapSnapshot> first, const HistoryOptions& options);

  /// Has news with every revision, and with End().
  NewsSource source() const { return source_; }

  // By the one thread that publishes.
  /// Nothing happens if the snapshot's version is the newest already.
  void Publish(std::shared_ptr<const MapSnapshot> snapshot, Clock::time_point now);
  /// The map is gone for good: `last` is the newest for ever, and everything before it is
  /// forgotten.
  void End(std::shared_ptr<const MapSnapshot> last);
  /// Forgets what is too old or too much; says when there will be something too old again. Apart
  /// from Publish(), because freeing hundreds of megabytes takes a while.
  std::optional<Clock::time_point> Trim(Clock::time_point now);

  /// Never null.
  std::shared_ptr<const MapSnapshot> newest() const;
  /// The snapshot of a version. FAILED_PRECONDITION, reason REVISION_EXPIRED, if it is not held any
  /// more or of another epoch; INVALID_ARGUMENT for a revision that does not exist yet.
  absl::StatusOr<std::shared_ptr<const MapSnapshot>> At(const MapVersion& version,
                                                        Clock::time_point now) const;
  /// The same for those who know what to do without it: null where At() gives an error.
  std::shared_ptr<const MapSnapshot> Find(const MapVersion& version, Clock::time_point now) const;

  /// What changed after `since` (nothing: everything is new) among the tiles of a level, within
  /// `rect` if there is one.
  TileChanges ChangesAfter(const std::optional<MapVersion>& since, int level,
                           const std::optional<TileRange>& rect) const;

  /// When the first revision after this one was published, as far as is remembered; nothing if it
  /// is the newest.
  std::optional<Clock::time_point> FirstNewsAfter(std::uint64_t revision) const;

  /// End() was called.
  bool ended() const;
  /// What the replaced revisions hold alone.
  std::uint64_t bytes() const;
  int num_replaced() const;
  /// How often At() found that a version is not kept.
  std::uint64_t num_expired_reads() const;

 private:
  struct Replaced {
    std::shared_ptr<const MapSnapshot> snapshot;
    Clock::time_point since;
    std::uint64_t bytes = 0;  ///< that no later revision holds
  };
  using Tombstones = absl::flat_hash_map<TileIndex, std::uint64_t>;  ///< revision of the removal
  /// What a revision changed for those who look back.
  struct Difference {
    std::uint64_t bytes = 0;
    std::array<std::vector<TileIndex>, kLevelMax + 1> gone;
    std::array<std::vector<TileIndex>, kLevelMax + 1> added;
  };

  std::shared_ptr<const MapSnapshot> FindLocked(const MapVersion& version,
                                                Clock::time_point now) const
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  static Difference Compare(const MapSnapshot& before, const MapSnapshot& after);
  void BuryLocked(const Difference& difference, std::uint64_t revision)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void ForgetTombstonesLocked() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  // Constant after construction.
  const HistoryOptions options_;
  const std::chrono::nanoseconds retention_;
  const NewsSource source_ = NewNewsSource();

  mutable Mutex mutex_;
  std::shared_ptr<const MapSnapshot> newest_ ABSL_GUARDED_BY(mutex_);
  std::deque<Replaced> replaced_ ABSL_GUARDED_BY(mutex_);  ///< by revision
  /// When the last revisions were published, the newest last.
  std::deque<Clock::time_point> published_ ABSL_GUARDED_BY(mutex_);
  std::uint64_t bytes_ ABSL_GUARDED_BY(mutex_) = 0;
  std::array<Tombstones, kLevelMax + 1> tombstones_ ABSL_GUARDED_BY(mutex_);
  /// Changes after this revision are known completely.
  std::uint64_t floor_ ABSL_GUARDED_BY(mutex_);
  bool ended_ ABSL_GUARDED_BY(mutex_) = false;
  mutable std::uint64_t num_expired_reads_ ABSL_GUARDED_BY(mutex_) = 0;
};

}  // namespace gem
