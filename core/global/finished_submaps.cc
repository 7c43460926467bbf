#include "core/global/finished_submaps.h"

#include <algorithm>
#include <functional>
#include <iterator>
#include <utility>

namespace gem {
namespace {

/// The cells of a submap for which keep(cell) is true; null without any.
template <typename Keep>
std::shared_ptr<const Submap> Filter(const std::shared_ptr<const Submap>& submap,
                                     const Keep& keep) {
  std::vector<KeyedSubmapCell> cells;
  for (const KeyedSubmapCell& cell : submap->Cells())
    if (keep(cell)) cells.push_back(cell);
  if (cells.empty()) return nullptr;
  if (cells.size() == submap->num_cells()) return submap;
  return std::make_shared<const Submap>(submap->origin(), cells, submap->parts(),
                                        submap->sources());
}

/// Two pieces of one submap that share no cell; one may be null. Null if they have too many sources
/// between them.
std::shared_ptr<const Submap> Unite(const std::shared_ptr<const Submap>& a,
                                    const std::shared_ptr<const Submap>& b) {
  if (a == nullptr || b == nullptr) return a == nullptr ? b : a;
  JoinedSources sources(a->sources(), b->sources());
  if (sources.full()) return nullptr;
  std::vector<KeyedSubmapCell> cells = a->Cells();
  for (KeyedSubmapCell cell : b->Cells()) {
    cell.source = sources.OfNewer(cell.source);
    cells.push_back(cell);
  }
  return std::make_shared<const Submap>(a->origin(), cells, a->parts(), sources.Take());
}

bool KnownTo(const std::shared_ptr<const Submap>& submap, CellIndex cell) {
  return submap != nullptr && submap->Find(cell).has_value();
}

/// Cells of a piece that `session` contributed to and that are more than its own.
std::uint64_t NumMerged(const Submap& piece, const std::string& session) {
  if (piece.origin().session != session) return piece.num_cells();
  std::uint64_t count = 0;
  for (std::size_t i = 0; i < piece.num_cells(); ++i)
    if (piece.sources()[piece.source(i)].size() > 1) ++count;
  return count;
}

}  // namespace

void FinishedSubmaps::Add(SubmapId id, std::shared_ptr<const Submap> submap) {
  // Nothing has been merged into it yet: it is its session's alone.
  Stored& stored = stored_[id];
  (IsRetracted(submap->origin().session) ? stored.hidden : stored.seen) = std::move(submap);
}

RetractionCounts FinishedSubmaps::Retract(
    const std::string& session, const std::vector<std::shared_ptr<const PlacedSubmap>>& placed) {
  RetractionCounts counts;
  retracted_.insert(session);
  for (auto& [id, stored] : stored_) {
    if (stored.seen == nullptr) continue;
    const std::vector<bool> goes = SourcesWithAny(stored.seen->sources(), {session});
    const auto is_going = [&](const KeyedSubmapCell& cell) { return goes[cell.source]; };
    const std::shared_ptr<const Submap> gone = Filter(stored.seen, is_going);
    if (gone == nullptr) continue;
    counts.num_merged_cells += NumMerged(*gone, session);
    stored.seen = Filter(stored.seen, std::not_fn(is_going));
    // What was hidden before gives way where a cell was seen since.
    if (stored.hidden != nullptr)
      stored.hidden = Filter(
          stored.hidden, [&](const KeyedSubmapCell& cell) { return !KnownTo(gone, cell.cell); });
    const std::shared_ptr<const Submap> hidden = Unite(stored.hidden, gone);
    stored.hidden = hidden != nullptr ? hidden : gone;
    if (stored.seen != nullptr) continue;
    ++counts.num_submaps;
    stored.left = LeftFrom(id, placed);
  }
  return counts;
}

RetractionCounts FinishedSubmaps::Restore(const std::string& session) {
  RetractionCounts counts;
  retracted_.erase(session);
  for (auto& [id, stored] : stored_) {
    if (stored.hidden == nullptr) continue;
    // What somebody else's retraction hides as well stays hidden.
    std::vector<bool> returns = SourcesWithAny(stored.hidden->sources(), {session});
    const std::vector<bool> stays = SourcesWithAny(stored.hidden->sources(), retracted_);
    for (std::size_t i = 0; i < returns.size(); ++i) returns[i] = returns[i] && !stays[i];
    const std::shared_ptr<const Submap> seen_before = stored.seen;
    const std::shared_ptr<const Submap> back =
        Filter(stored.hidden, [&](const KeyedSubmapCell& cell) {
          return returns[cell.source] && !KnownTo(seen_before, cell.cell);
        });
    stored.hidden =
        Filter(stored.hidden, [&](const KeyedSubmapCell& cell) { return !returns[cell.source]; });
    if (back == nullptr) continue;
    const std::shared_ptr<const Submap> seen = Unite(seen_before, back);
    if (seen == nullptr) continue;
    counts.num_merged_cells += NumMerged(*back, session);
    if (stored.seen == nullptr) ++counts.num_submaps;
    stored.seen = seen;
  }
  // One of which nothing is left: all that was hidden has been mapped anew by others meanwhile.
  absl::erase_if(stored_, [](const auto& each) {
    return each.second.seen == nullptr && each.second.hidden == nullptr;
  });
  return counts;
}

std::optional<FinishedSubmaps::Stored::Left> FinishedSubmaps::LeftFrom(
    SubmapId id, const std::vector<std::shared_ptr<const PlacedSubmap>>& placed) const {
  const auto found = std::lower_bound(
      placed.begin(), placed.end(), id,
      [](const std::shared_ptr<const PlacedSubmap>& p, SubmapId of) { return p->id < of; });
  if (found == placed.end() || (*found)->id != id || !(*found)->finished) return std::nullopt;
  return Stored::Left{(*found)->T_G_K, state_};
}

void FinishedSubmaps::Adopt(const std::vector<std::shared_ptr<const PlacedSubmap>>& placed) {
  auto next = placed.begin();
  for (auto it = stored_.begin(); it != stored_.end();) {
    Stored& stored = it->second;
    while (next != placed.end() && (*next)->id < it->first) ++next;
    if (next != placed.end() && (*next)->id == it->first) {
      stored.seen = (*next)->submap;
    } else {
      stored.seen = nullptr;  // merged into another, if there was anything to be seen
    }
    it = stored.seen == nullptr && stored.hidden == nullptr ? stored_.erase(it) : std::next(it);
  }
}

std::uint64_t FinishedSubmaps::HiddenBytes() const {
  std::uint64_t bytes = 0;
  for (const auto& [id, stored] : stored_)
    if (stored.hidden != nullptr) bytes += stored.hidden->size_bytes();
  return bytes;
}

}  // namespace gem
