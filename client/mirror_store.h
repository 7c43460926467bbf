// What a mirror holds: puts the parts of a change together and shows them all at once. Knows
// nothing of connections; part of MapMirror.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "absl/container/flat_hash_map.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/map_types.h"
#include "client/mirrored_map.h"
#include "core/base/latest.h"
#include "core/grid/map_version.h"

namespace gem::client {

/// What does not change within an epoch.
struct MirrorGeometry {
  int level = 0;
  double cell_size_m = 0;  ///< at that level
  float traversability_free = 0;
  std::uint64_t epoch = 0;
};

/// A part of a change, as gem.v1.WatchTilesResponse has it.
struct MirrorPart {
  std::optional<MapVersion> base;
  MapVersion version;
  bool reset = false;
  std::vector<MapTile> tiles;  ///< without a grid: it went
  bool complete = false;
  std::uint64_t num_versions_skipped = 0;
};

/// For one thread, but for snapshot(), which is for any.
class MirrorStore {
 public:
  explicit MirrorStore(std::size_t tiles_max) : tiles_max_(tiles_max) {}

  /// Of the changes to come. Before the first.
  void SetGeometry(const MirrorGeometry& geometry) { geometry_ = geometry; }

  enum class Taken {
    kPart,        ///< more parts are to come
    kNothingNew,  ///< a change without a change: what is held is the newest
    kVersion,     ///< snapshot() is a new version
  };
  /// ABORTED if the part does not continue what is held, or is of another epoch than the geometry:
  /// the next change must be one with reset. RESOURCE_EXHAUSTED if there are more than tiles_max.
  absl::StatusOr<Taken> Take(MirrorPart part);
  /// The rest of a change will not come.
  void DropParts() { change_.reset(); }

  /// The version to go on from; nothing: from the beginning.
  std::optional<MapVersion> held() const {
    if (newest_ == nullptr) return std::nullopt;
    return newest_->version;
  }
  bool has_parts() const { return change_.has_value(); }
  /// Addresses whose cells differ between the last two snapshots.
  const std::vector<TileIndex>& changed() const { return changed_; }

  /// The newest complete version; null before the first. Never waits for the writer's work.
  std::shared_ptr<const MirroredMap> snapshot() const { return snapshot_.Get(); }

 private:
  using Tiles = absl::flat_hash_map<TileIndex, MapTile>;
  struct Change {
    bool reset = false;
    Tiles tiles;                ///< new ones, and held ones that go: without a grid
    std::size_t num_after = 0;  ///< tiles that there will be
  };

  /// What the change is applied to.
  const Tiles& Base() const;
  absl::Status Continue(const MirrorPart& part);
  absl::Status Add(MapTile tile);
  void Publish(const MapVersion& version);

  const std::size_t tiles_max_;
  MirrorGeometry geometry_;
  std::optional<Change> change_;  ///< parts that are not complete
  std::vector<TileIndex> changed_;
  /// The writer's own view of snapshot_.
  std::shared_ptr<const MirroredMap> newest_;
  Latest<MirroredMap> snapshot_;
};

}  // namespace gem::client
