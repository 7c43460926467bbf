// The finished submaps of a map: what is seen of each, and what is hidden because a session that
// contributed to it is retracted. Places nothing and renders nothing. Not thread-safe.
//
// A retracted session's cells, and those that were fused from its scans and others', are hidden,
// not dropped: they come back with it. What is seen may change meanwhile; where both know a cell
// then, the seen one stays.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/container/btree_map.h"
#include "absl/container/flat_hash_set.h"
#include "core/global/placement.h"
#include "core/global/retraction.h"
#include "core/global/submap.h"

namespace gem {

class FinishedSubmaps {
 public:
  struct Stored {
    std::shared_ptr<const Submap> seen;    ///< null: nothing of it
    std::shared_ptr<const Submap> hidden;  ///< null: nothing of it
    /// Where it was, and in which state of the map, when it was hidden as a whole.
    struct Left {
      Pose<Global, Submap> T_G_K;
      std::uint64_t state = 0;
    };
    std::optional<Left> left;
  };

  const absl::btree_map<SubmapId, Stored>& all() const { return stored_; }

  /// As they were when the map was written down: `left` counts only for those that are hidden and
  /// in no other state of the map.
  void Load(SubmapId id, Stored stored) { stored_[id] = std::move(stored); }
  void LoadRetracted(const std::string& session) { retracted_.insert(session); }
  /// T_G_K at which it was hidden as a whole, if the map is as it was then.
  std::optional<Pose<Global, Submap>> LeftAt(const Stored& stored) const {
    if (!stored.left.has_value() || stored.left->state != state_) return std::nullopt;
    return stored.left->T_G_K;
  }

  /// A new one; hidden if its session is retracted.
  void Add(SubmapId id, std::shared_ptr<const Submap> submap);
  /// Hides what a session contributed that is not retracted. placed: as published, by id.
  RetractionCounts Retract(const std::string& session,
                           const std::vector<std::shared_ptr<const PlacedSubmap>>& placed);
  /// Shows it again, but what others have mapped anew meanwhile, and what other retracted sessions
  /// contributed to as well. The session is retracted.
  RetractionCounts Restore(const std::string& session);
  bool IsRetracted(const std::string& session) const { return retracted_.contains(session); }

  /// Takes over what was published: submaps may have been merged into others. placed: by id.
  void Adopt(const std::vector<std::shared_ptr<const PlacedSubmap>>& placed);
  /// Submaps have come, moved or been merged since those were hidden that are.
  void NoteChange() { ++state_; }
  /// True for a submap that comes back to a map that is as it was when it left: maintenance has
  /// looked at it then.
  bool CameBack(const Stored& stored, const Pose<Global, Submap>& T_G_K) const {
    const std::optional<Pose<Global, Submap>> left = LeftAt(stored);
    return left.has_value() && Identical(*left, T_G_K);
  }

  /// What hidden cells occupy.
  std::uint64_t HiddenBytes() const;

 private:
  std::optional<Stored::Left> LeftFrom(
      SubmapId id, const std::vector<std::shared_ptr<const PlacedSubmap>>& placed) const;

  absl::btree_map<SubmapId, Stored> stored_;
  absl::flat_hash_set<std::string> retracted_;
  std::uint64_t state_ = 0;
};

}  // namespace gem
