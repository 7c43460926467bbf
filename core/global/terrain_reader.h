// The ground of a published map, cell by cell and between cells. Not thread-safe: one for each
// question, as it remembers the tile it read last.
#pragma once

#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/statusor.h"
#include "core/global/map_snapshot.h"
#include "core/grid/terrain.h"

namespace gem {

/// Asked now and then during a long answer; true: nobody waits for it any more.
using Abandoned = absl::FunctionRef<bool()>;

class TerrainReader {
 public:
  /// Keeps a reference.
  explicit TerrainReader(const MapSnapshot& map)
      : map_(map), cell_size_m_(static_cast<double>(map.options.cell_size_m)) {}

  double cell_size_m() const { return cell_size_m_; }

  /// Null if nothing is known of the cell.
  const CellBelief* Find(CellIndex cell);
  /// The cell as a whole: its own height.
  GroundSample AtCell(CellIndex cell);
  /// The cell at the place, but with the height and variance interpolated between the middles of
  /// the four cells around the place if all of them are known. The variance is a weighted mean, as
  /// if the errors of neighbours were the same: those of the pose are.
  GroundSample AtPlace(const Place& place);

 private:
  std::optional<float> SlopeAt(CellIndex cell);
  void Interpolate(const Place& place, GroundSample& sample);

  const MapSnapshot& map_;
  const double cell_size_m_;
  TileIndex tile_index_;
  const Tile* tile_ = nullptr;  ///< null: there is none at tile_index_
  bool has_tile_ = false;       ///< tile_index_ and tile_ were set
};

/// One sample for each point, within 1e6 m. CANCELLED if abandoned.
absl::StatusOr<std::vector<GroundSample>> SampleHeights(const MapSnapshot& map,
                                                        const std::vector<Place>& points,
                                                        Abandoned abandoned);

}  // namespace gem
