#include "server/map_history.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "proto/wire/refusal.h"
#include "server/error_reason.h"

namespace gem {
namespace {

constexpr std::size_t kPublicationsRemembered_max = 1024;

std::uint64_t BytesOf(const Tile& tile) {
  return sizeof(Tile) + tile.cells.size() * sizeof(CellBelief);
}

/// What a snapshot occupies besides its tiles, which it shares with its neighbours.
std::uint64_t BytesOfBooks(const MapSnapshot& snapshot) {
  std::uint64_t bytes = sizeof(MapSnapshot) + snapshot.submaps.size() * sizeof(SubmapInfo) +
                        snapshot.sessions.size() * sizeof(SessionInfo);
  for (int level = 0; level <= kLevelMax; ++level)
    bytes += snapshot.TilesOf(level).capacity() * (sizeof(TileMap::value_type) + 1);
  return bytes;
}

/// Calls visit(index, value) for the entries within the rectangle, by the shorter way.
template <typename Map, typename Visit>
void ForEachWithin(const Map& map, const std::optional<TileRange>& rect, Visit visit) {
  if (rect.has_value() && rect->num_tiles() < map.size()) {
    for (TileIndex index = rect->min; index.y < rect->max.y; ++index.y)
      for (index.x = rect->min.x; index.x < rect->max.x; ++index.x)
        if (const auto it = map.find(index); it != map.end()) visit(index, it->second);
    return;
  }
  for (const auto& [index, value] : map)
    if (!rect.has_value() || rect->Contains(index)) visit(index, value);
}

absl::Status Expired(const MapVersion& version, const MapVersion& newest, double retention_s) {
  return WithErrorReason(
      wire::WithField(
          absl::FailedPreconditionError(absl::StrCat(
              "at is revision ", version.revision, " of epoch ", version.epoch,
              ", which is not kept, want one that was the newest in the last ", retention_s,
              " s; the newest is revision ", newest.revision, " of epoch ", newest.epoch)),
          "at"),
      kRevisionExpired);
}

}  // namespace

MapHistory::MapHistory(std::shared_ptr<const MapSnapshot> first, const HistoryOptions& options)
    : options_(options),
      retention_(static_cast<std::int64_t>(options.retention_s * 1e9)),
      newest_(std::move(first)),
      floor_(newest_->version.revision) {}

void MapHistory::Publish(std::shared_ptr<const MapSnapshot> snapshot, Clock::time_point now) {
  const std::shared_ptr<const MapSnapshot> before = newest();
  if (before->version == snapshot->version) return;
  // Without the lock: only this thread replaces the newest.
  const Difference difference = Compare(*before, *snapshot);
  {
    MutexLock lock(mutex_);
    BuryLocked(difference, snapshot->version.revision);
    replaced_.push_back({std::exchange(newest_, std::move(snapshot)), now, difference.bytes});
    bytes_ += difference.bytes;
    published_.push_back(now);
    if (published_.size() > kPublicationsRemembered_max) published_.pop_front();
  }
  if (options_.listener != nullptr) options_.listener->OnNews(source_);
}

void MapHistory::End(std::shared_ptr<const MapSnapshot> last) {
  std::deque<Replaced> dropped;  // destroyed after the lock is released, as `last` is
  {
    MutexLock lock(mutex_);
    ended_ = true;
    dropped.swap(replaced_);
    bytes_ = 0;
    published_.clear();
    for (Tombstones& of_level : tombstones_) of_level.clear();
    floor_ = last->version.revision;
    newest_.swap(last);
  }
  if (options_.listener != nullptr) options_.listener->OnNews(source_);
}

std::optional<Clock::time_point> MapHistory::Trim(Clock::time_point now) {
  std::vector<Replaced> dropped;  // destroyed after the lock is released
  MutexLock lock(mutex_);
  while (!replaced_.empty() &&
         (bytes_ > options_.bytes_max || replaced_.front().since + retention_ <= now)) {
    bytes_ -= replaced_.front().bytes;
    dropped.push_back(std::move(replaced_.front()));
    replaced_.pop_front();
  }
  if (replaced_.empty()) return std::nullopt;
  return replaced_.front().since + retention_;
}

std::shared_ptr<const MapSnapshot> MapHistory::newest() const {
  MutexLock lock(mutex_);
  return newest_;
}

absl::StatusOr<std::shared_ptr<const MapSnapshot>> MapHistory::At(const MapVersion& version,
                                                                  Clock::time_point now) const {
  MutexLock lock(mutex_);
  if (std::shared_ptr<const MapSnapshot> found = FindLocked(version, now)) return found;
  const MapVersion newest = newest_->version;
  if (version.epoch == newest.epoch && version.revision > newest.revision)
    return wire::Refuse(wire::FieldPath("at").Child("revision"), absl::StrCat(version.revision),
                        absl::StrCat("at most ", newest.revision, ", which is the newest"));
  ++num_expired_reads_;
  return Expired(version, newest, options_.retention_s);
}

std::shared_ptr<const MapSnapshot> MapHistory::Find(const MapVersion& version,
                                                    Clock::time_point now) const {
  MutexLock lock(mutex_);
  return FindLocked(version, now);
}

std::shared_ptr<const MapSnapshot> MapHistory::FindLocked(const MapVersion& version,
                                                          Clock::time_point now) const {
  if (version == newest_->version) return newest_;
  const auto found = std::lower_bound(
      replaced_.begin(), replaced_.end(), version.revision,
      [](const Replaced& r, std::uint64_t v) { return r.snapshot->version.revision < v; });
  const bool is_kept = found != replaced_.end() && found->snapshot->version == version &&
                       found->since + retention_ > now;
  return is_kept ? found->snapshot : nullptr;
}

TileChanges MapHistory::ChangesAfter(const std::optional<MapVersion>& since, int level,
                                     const std::optional<TileRange>& rect) const {
  TileChanges changes;
  {
    MutexLock lock(mutex_);
    changes.snapshot = newest_;
    const MapVersion newest = newest_->version;
    changes.reset = !since.has_value() || since->epoch != newest.epoch ||
                    since->revision < floor_ || since->revision > newest.revision;
    if (!changes.reset)
      ForEachWithin(tombstones_[static_cast<std::size_t>(level)], rect,
                    [&](TileIndex index, std::uint64_t revision) {
                      if (revision > since->revision) changes.tiles.push_back(index);
                    });
  }
  ForEachWithin(changes.snapshot->TilesOf(level), rect, [&](TileIndex index, const auto& tile) {
    if (changes.reset || tile->version.revision > since->revision) changes.tiles.push_back(index);
  });
  return changes;
}

std::optional<Clock::time_point> MapHistory::FirstNewsAfter(std::uint64_t revision) const {
  MutexLock lock(mutex_);
  const std::uint64_t newest = newest_->version.revision;
  if (revision >= newest || published_.empty()) return std::nullopt;
  const std::uint64_t num_after = std::min<std::uint64_t>(newest - revision, published_.size());
  return published_[published_.size() - num_after];
}

bool MapHistory::ended() const {
  MutexLock lock(mutex_);
  return ended_;
}

std::uint64_t MapHistory::bytes() const {
  MutexLock lock(mutex_);
  return bytes_;
}

int MapHistory::num_replaced() const {
  MutexLock lock(mutex_);
  return static_cast<int>(replaced_.size());
}

std::uint64_t MapHistory::num_expired_reads() const {
  MutexLock lock(mutex_);
  return num_expired_reads_;
}

MapHistory::Difference MapHistory::Compare(const MapSnapshot& before, const MapSnapshot& after) {
  Difference difference;
  difference.bytes = BytesOfBooks(before);
  for (int level = 0; level <= kLevelMax; ++level) {
    const auto at = static_cast<std::size_t>(level);
    const TileMap& was = before.TilesOf(level);
    const TileMap& is = after.TilesOf(level);
    for (const auto& [index, tile] : was) {
      const auto found = is.find(index);
      if (found == is.end()) difference.gone[at].push_back(index);
      if (found == is.end() || found->second != tile) difference.bytes += BytesOf(*tile);
    }
    for (const auto& [index, tile] : is)
      if (!was.contains(index)) difference.added[at].push_back(index);
  }
  return difference;
}

void MapHistory::BuryLocked(const Difference& difference, std::uint64_t revision) {
  std::size_t num_tombstones = 0;
  for (std::size_t level = 0; level < tombstones_.size(); ++level) {
    for (const TileIndex index : difference.added[level]) tombstones_[level].erase(index);
    for (const TileIndex index : difference.gone[level]) tombstones_[level][index] = revision;
    num_tombstones += tombstones_[level].size();
  }
  if (num_tombstones > options_.tombstones_max) ForgetTombstonesLocked();
}

void MapHistory::ForgetTombstonesLocked() {
  // The older half at once: not again with every removal.
  std::vector<std::uint64_t> revisions;
  for (const Tombstones& of_level : tombstones_)
    for (const auto& [index, revision] : of_level) revisions.push_back(revision);
  const auto middle = revisions.begin() + static_cast<std::ptrdiff_t>(revisions.size() / 2);
  std::nth_element(revisions.begin(), middle, revisions.end());
  floor_ = std::max(floor_, *middle);
  for (Tombstones& of_level : tombstones_)
    absl::erase_if(of_level, [floor = floor_](const auto& entry) { return entry.second <= floor; });
}

}  // namespace gem
