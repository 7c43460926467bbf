#include "server/tile_watch.h"

#include <algorithm>
#include <utility>

#include "absl/container/flat_hash_set.h"
#include "server/error_reason.h"

namespace gem {
namespace {

std::optional<TileRange> RangeOf(const TileWatchOptions& options, double cell_size_m) {
  if (!options.region.has_value()) return std::nullopt;
  return TilesTouching(*options.region, options.level, cell_size_m);
}

std::chrono::nanoseconds Seconds(double seconds) {
  return std::chrono::nanoseconds(static_cast<std::int64_t>(seconds * 1e9));
}

/// The middle of the tiles' bounding box. tiles is not empty.
Place MiddleOf(const std::vector<TileIndex>& tiles, double side_m) {
  TileIndex min = tiles.front();
  TileIndex max = min;
  for (const TileIndex tile : tiles) {
    min = {std::min(min.x, tile.x), std::min(min.y, tile.y)};
    max = {std::max(max.x, tile.x), std::max(max.y, tile.y)};
  }
  return {(min.x + max.x + 1) / 2.0 * side_m, (min.y + max.y + 1) / 2.0 * side_m};
}

absl::Status TooSlow() {
  return WithErrorReason(
      absl::FailedPreconditionError(
          "the version of this stream is not kept any more: it was read too slowly"),
      kRevisionExpired);
}

TileWatch::Turn WaitFor(std::optional<Clock::time_point> wake_at) {
  TileWatch::Turn turn;
  turn.kind = TileWatch::Turn::Kind::kWait;
  turn.wake_at = wake_at;
  return turn;
}

TileWatch::Turn EndWith(absl::Status status) {
  TileWatch::Turn turn;
  turn.kind = TileWatch::Turn::Kind::kEnd;
  turn.status = std::move(status);
  return turn;
}

}  // namespace

TileWatch::TileWatch(std::shared_ptr<const MapHistory> history, const TileWatchOptions& options,
                     Clock::time_point now)
    : history_(std::move(history)),
      options_(options),
      range_(RangeOf(options, history_->newest()->options.cell_size_m)),
      part_bytes_(options.bytes_per_s_max == 0
                      ? kPartBytes
                      : std::min<std::size_t>(kPartBytes, options.bytes_per_s_max)),
      created_(now),
      base_(options.since),
      next_change_at_(now),
      next_part_at_(now) {}

TileWatch::Turn TileWatch::TakeTurn(Clock::time_point now, TileSink& sink) {
  if (done_) return EndWith(absl::OkStatus());
  if (history_->ended()) return EndWith(absl::NotFoundError("the map was deleted"));
  if (now < next_part_at_) return WaitFor(next_part_at_);
  if (change_.has_value()) {
    std::shared_ptr<const MapSnapshot> snapshot = history_->Find(change_->target, now);
    if (snapshot == nullptr && options_.once) return EndWith(TooSlow());
    if (snapshot == nullptr) snapshot = Retarget();
    return MakePart(*snapshot, sink);
  }
  // A reader that resumes hears at once that it has everything, if it has.
  if (told_any_ && base_ == history_->newest()->version) return WaitFor(std::nullopt);
  if (now < next_change_at_) return WaitFor(next_change_at_);
  return MakePart(*Begin(now), sink);
}

std::shared_ptr<const MapSnapshot> TileWatch::Begin(Clock::time_point now) {
  TileChanges changes = history_->ChangesAfter(base_, options_.level, range_);
  change_ = Change{};
  change_->target = changes.snapshot->version;
  change_->reset = changes.reset;
  change_->due = std::move(changes.tiles);
  SortByDistance(change_->due, changes.snapshot->options.cell_size_m);
  next_change_at_ = now + Seconds(options_.min_interval_s);
  next_change_ticks_.store(next_change_at_.time_since_epoch().count(), std::memory_order_relaxed);
  return changes.snapshot;
}

std::shared_ptr<const MapSnapshot> TileWatch::Retarget() {
  TileChanges changes = history_->ChangesAfter(change_->target, options_.level, range_);
  change_->target = changes.snapshot->version;
  SortByDistance(changes.tiles, changes.snapshot->options.cell_size_m);
  if (changes.reset) {
    change_->reset = true;
    change_->reset_told = false;
    change_->due = std::move(changes.tiles);
    return changes.snapshot;
  }
  // What has not been told at all goes before what has changed again: a slow reader of a map that
  // changes all the time gets every tile.
  const absl::flat_hash_set<TileIndex> due(change_->due.begin(), change_->due.end());
  std::vector<TileIndex> next;
  for (const TileIndex index : changes.tiles)
    if (!due.contains(index)) next.push_back(index);
  next.insert(next.end(), change_->due.begin(), change_->due.end());
  change_->due = std::move(next);
  return changes.snapshot;
}

TileWatch::Turn TileWatch::MakePart(const MapSnapshot& snapshot, TileSink& sink) {
  const TileMap& tiles = snapshot.TilesOf(options_.level);
  int num_tiles = 0;
  while (!change_->due.empty() && num_tiles < kTilesOfPart_max && sink.size_bytes() < part_bytes_) {
    const TileIndex index = change_->due.back();
    change_->due.pop_back();
    if (const auto found = tiles.find(index); found != tiles.end()) {
      sink.Add(*found->second);
      ++num_tiles;
    } else {
      sink.AddAbsent({options_.level, index}, snapshot.version);
    }
  }
  told_any_ = true;
  Turn turn;
  turn.kind = Turn::Kind::kPart;
  if (!change_->reset) turn.base = base_;
  turn.version = snapshot.version;
  turn.reset = change_->reset && !std::exchange(change_->reset_told, true);
  turn.complete = change_->due.empty();
  if (!turn.complete) return turn;
  if (turn.base.has_value() && turn.version.revision > turn.base->revision)
    turn.num_versions_skipped = turn.version.revision - turn.base->revision - 1;
  base_ = snapshot.version;
  complete_revision_.store(base_->revision, std::memory_order_relaxed);
  change_.reset();
  done_ = options_.once;
  return turn;
}

void TileWatch::CountSent(std::size_t bytes, Clock::time_point now) {
  if (options_.bytes_per_s_max == 0) return;
  next_part_at_ =
      std::max(next_part_at_, now) +
      Seconds(static_cast<double>(bytes) / static_cast<double>(options_.bytes_per_s_max));
}

std::optional<Clock::time_point> TileWatch::behind_since() const {
  const std::uint64_t revision = complete_revision_.load(std::memory_order_relaxed);
  if (revision == kNone) return created_;
  std::optional<Clock::time_point> since = history_->FirstNewsAfter(revision);
  const Clock::time_point may_begin(
      Clock::duration(next_change_ticks_.load(std::memory_order_relaxed)));
  if (since.has_value()) since = std::max(*since, may_begin);
  return since;
}

void TileWatch::SortByDistance(std::vector<TileIndex>& tiles, double cell_size_m) const {
  if (tiles.empty()) return;
  const double side_m = TileSideAt(options_.level, cell_size_m);
  const Place from = options_.nearest_to.has_value() ? *options_.nearest_to
                     : options_.region.has_value()   ? options_.region->middle()
                                                     : MiddleOf(tiles, side_m);
  const auto distance_m2 = [&](TileIndex tile) {
    const double x_m = (tile.x + 0.5) * side_m - from.x_m;
    const double y_m = (tile.y + 0.5) * side_m - from.y_m;
    return x_m * x_m + y_m * y_m;
  };
  std::sort(tiles.begin(), tiles.end(), [&](TileIndex a, TileIndex b) {
    const double far_a = distance_m2(a);
    const double far_b = distance_m2(b);
    return far_a != far_b ? far_a > far_b : b < a;
  });
}

}  // namespace gem
