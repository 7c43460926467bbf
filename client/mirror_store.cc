#include "client/mirror_store.h"

#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "core/base/status_macros.h"

namespace gem::client {
namespace {

std::string NameOf(const std::optional<MapVersion>& version) {
  return version ? absl::StrCat(version->epoch, ".", version->revision) : std::string("nothing");
}

/// What cannot be compared differs.
bool SameCells(const MapTile& a, const MapTile& b) { return a.etag != 0 && a.etag == b.etag; }

}  // namespace

absl::StatusOr<MirrorStore::Taken> MirrorStore::Take(MirrorPart part) {
  GEM_RETURN_IF_ERROR(Continue(part));
  for (MapTile& tile : part.tiles) GEM_RETURN_IF_ERROR(Add(std::move(tile)));
  if (!part.complete) return Taken::kPart;
  const bool is_new =
      held() != std::optional(part.version) || change_->reset || !change_->tiles.empty();
  if (is_new) Publish(part.version);
  change_.reset();
  return is_new ? Taken::kVersion : Taken::kNothingNew;
}

const MirrorStore::Tiles& MirrorStore::Base() const {
  static const Tiles kNone;
  return newest_ == nullptr || change_->reset ? kNone : newest_->tiles;
}

absl::Status MirrorStore::Continue(const MirrorPart& part) {
  if (part.version.epoch != geometry_.epoch)
    return absl::AbortedError(absl::StrCat("the server sent epoch ", part.version.epoch, ", want ",
                                           geometry_.epoch, ", of which the geometry is"));
  if (part.reset) {
    // Also in the middle of a change: what came before it counts no more.
    change_ = Change{true, {}, 0};
    return absl::OkStatus();
  }
  const bool after_reset = change_.has_value() && change_->reset;
  // Nothing is no base, although nothing is held.
  if (!after_reset && (!part.base || part.base != held()))
    return absl::AbortedError(absl::StrCat("the server sent a change of ", NameOf(part.base),
                                           ", want one of ", NameOf(held()), ", which is held"));
  if (!change_) change_ = Change{false, {}, newest_->tiles.size()};
  return absl::OkStatus();
}

absl::Status MirrorStore::Add(MapTile tile) {
  const bool is_held = Base().contains(tile.index);
  const auto told = change_->tiles.find(tile.index);
  const bool was_there = told == change_->tiles.end() ? is_held : told->second.grid != nullptr;
  const bool is_there = tile.grid != nullptr;
  change_->num_after = change_->num_after + (is_there ? 1 : 0) - (was_there ? 1 : 0);
  if (change_->num_after > tiles_max_)
    return absl::ResourceExhaustedError(
        absl::StrCat("the region has more than ", tiles_max_,
                     " tiles, want a smaller region, a coarser level, or a higher tiles_max"));
  if (is_there || is_held) {
    change_->tiles[tile.index] = std::move(tile);
  } else if (told != change_->tiles.end()) {
    change_->tiles.erase(told);
  }
  return absl::OkStatus();
}

void MirrorStore::Publish(const MapVersion& version) {
  auto next = std::make_shared<MirroredMap>();
  next->version = version;
  next->level = geometry_.level;
  next->cell_size_m = geometry_.cell_size_m;
  next->traversability_free = geometry_.traversability_free;
  next->tiles = Base();
  changed_.clear();
  static const Tiles kNone;
  const Tiles& before = newest_ == nullptr ? kNone : newest_->tiles;
  if (change_->reset)
    for (const auto& [index, tile] : before)
      if (!change_->tiles.contains(index)) changed_.push_back(index);
  for (auto& [index, tile] : change_->tiles) {
    const auto old = before.find(index);
    const bool same = old != before.end() && tile.grid != nullptr && SameCells(old->second, tile);
    if (!same) changed_.push_back(index);
    if (tile.grid == nullptr) {
      next->tiles.erase(index);
    } else {
      // Cells that a reader may still hold are not kept twice.
      if (same) tile.grid = old->second.grid;
      next->tiles[index] = std::move(tile);
    }
  }
  newest_ = next;
  snapshot_.Set(newest_);
}

}  // namespace gem::client
