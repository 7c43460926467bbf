// Renders the tiles that a change touches, on a few threads, and keeps what the submaps alone say
// of each tile, so that a local map that moves does not cost a rendering of the submaps below it.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "absl/container/flat_hash_map.h"
#include "core/base/cancel_token.h"
#include "core/global/global_map_options.h"
#include "core/global/map_snapshot.h"
#include "core/global/placement.h"
#include "core/global/tile_renderer.h"

namespace gem {

/// Everything that shows in the map, at its place.
struct MapContent {
  std::vector<std::shared_ptr<const PlacedSubmap>> submaps;       ///< by id
  std::vector<std::shared_ptr<const PlacedLocalMap>> local_maps;  ///< by session
};

class TileComposer {
 public:
  explicit TileComposer(const GlobalMapOptions& options) : options_(options) {}

  /// Tiles as they will be. Nothing is kept until Adopt().
  struct Result {
    struct Rendered {
      TileIndex index;
      std::shared_ptr<const Tile> tile;       ///< null: no known cell
      std::shared_ptr<const TileCells> base;  ///< submaps only; null: no known cell
    };
    std::vector<Rendered> rendered;
    std::vector<TileIndex> changed;  ///< rendered, and some cell differs from `tiles`
    bool cancelled = false;
  };

  /// Renders what differs between two states of the map. tiles: as published with `before`. Tiles
  /// whose cells come out as they were keep their version; others get `version`.
  Result Compose(const MapContent& before, const MapContent& after, const TileMap& tiles,
                 const MapVersion& version, const CancelToken& cancel) const;

  /// Puts a result into the tiles that it was rendered for.
  static void Apply(const Result& result, TileMap& tiles);

  /// The result is published: keeps its bases.
  void Adopt(const Result& result);

 private:
  struct Job;
  struct Plan;

  static Plan MakePlan(const MapContent& before, const MapContent& after);
  Result::Rendered Run(const Job& job, const TileMap& tiles, const MapVersion& version) const;

  const GlobalMapOptions options_;
  absl::flat_hash_map<TileIndex, std::shared_ptr<const TileCells>> bases_;
};

}  // namespace gem
