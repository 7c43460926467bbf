#include "server/tile_encoder.h"

#include <utility>

#include "proto/wire/local_map_message.h"

namespace gem {
namespace {

std::uint32_t BitsOf(const std::vector<Layer>& layers) {
  std::uint32_t bits = 0;
  for (const Layer layer : layers) bits |= 1u << static_cast<unsigned>(layer);
  return bits;
}

}  // namespace

TileEncoder::TileEncoder(EncodedCache& cache, NewsSource map, float cell_size_m,
                         wire::CellSelection cells)
    : cache_(cache), map_(map), cell_size_m_(cell_size_m), cells_(std::move(cells)) {}

EncodedCache::Encoded TileEncoder::Encode(const Tile& tile) const {
  return cache_.Get(
      {map_, tile.version.revision, AddressOf(tile), BitsOf(cells_.layers), cells_.encoding},
      [&] { return wire::EncodeTile(tile, cell_size_m_, cells_.layers, cells_.encoding); });
}

EncodedCache::Encoded EncodeGrid(EncodedCache& cache, NewsSource robot, std::uint64_t number,
                                 const LocalMap& map, const wire::CellSelection& cells) {
  return cache.Get({robot, number, {}, BitsOf(cells.layers), cells.encoding},
                   [&] { return wire::EncodeGrid(map, cells.layers, cells.encoding); });
}

}  // namespace gem
