// Cells of one map, or of one robot's local maps, as one reader wants them, through the cache of
// all.
#pragma once

#include <memory>

#include "core/global/map_snapshot.h"
#include "core/local/local_map.h"
#include "proto/wire/tile_request.h"
#include "server/encoded_cache.h"

namespace gem {

/// Thread-safe.
class TileEncoder {
 public:
  /// The cache outlives the encoder. cell_size_m: of the map, at level 0.
  TileEncoder(EncodedCache& cache, NewsSource map, float cell_size_m, wire::CellSelection cells);
  EncodedCache::Encoded Encode(const Tile& tile) const;

 private:
  EncodedCache& cache_;
  const NewsSource map_;
  const float cell_size_m_;
  const wire::CellSelection cells_;
};

/// The grid of a local map, of which `number` is the robot's.
EncodedCache::Encoded EncodeGrid(EncodedCache& cache, NewsSource robot, std::uint64_t number,
                                 const LocalMap& map, const wire::CellSelection& cells);

}  // namespace gem
