#include "core/global/terrain_reader.h"

#include <array>
#include <cmath>

#include "core/local/annotate.h"

namespace gem {
namespace {

/// Between two looks at whether the answer is still wanted.
constexpr std::size_t kPointsBetweenLooks = 1024;

/// A plane needs three cells; annotating asks for more, but its 5x5 cells are not kept in tiles.
constexpr std::int32_t kSlopeCells_min = 3;

}  // namespace

const CellBelief* TerrainReader::Find(CellIndex cell) {
  const TileIndex index = TileOf(cell);
  if (!has_tile_ || index != tile_index_) {
    const auto found = map_.tiles.find(index);
    tile_ = found == map_.tiles.end() ? nullptr : found->second.get();
    tile_index_ = index;
    has_tile_ = true;
  }
  if (tile_ == nullptr) return nullptr;
  const CellBelief& belief = tile_->cells[static_cast<std::size_t>(IndexInTile(cell))];
  return belief.known() ? &belief : nullptr;
}

GroundSample TerrainReader::AtCell(CellIndex cell) {
  const CellBelief* belief = Find(cell);
  if (belief == nullptr) return {};
  GroundSample sample;
  sample.elevation_m = belief->elevation_m;
  sample.variance_m2 = belief->variance_m2;
  sample.slope_rad = SlopeAt(cell);
  if (!belief->annotated()) {
    sample.state = GroundState::kHeightOnly;
    return sample;
  }
  sample.traversability = belief->traversability;
  sample.state = belief->traversability > map_.options.traversability_free ? GroundState::kFree
                                                                           : GroundState::kObstacle;
  return sample;
}

GroundSample TerrainReader::AtPlace(const Place& place) {
  GroundSample sample = AtCell(CellAt(place.x_m, place.y_m, cell_size_m_));
  // Between neighbours of an unknown cell nothing is made up.
  if (sample.state != GroundState::kUnknown) Interpolate(place, sample);
  return sample;
}

void TerrainReader::Interpolate(const Place& place, GroundSample& sample) {
  const double x_cells = place.x_m / cell_size_m_ - 0.5;
  const double y_cells = place.y_m / cell_size_m_ - 0.5;
  const double left = std::floor(x_cells);
  const double below = std::floor(y_cells);
  const double right_weight = x_cells - left;
  const double upper_weight = y_cells - below;
  const CellIndex corner{static_cast<std::int32_t>(left), static_cast<std::int32_t>(below)};
  double elevation_m = 0;
  double variance_m2 = 0;
  for (const std::int32_t dy : {0, 1}) {
    for (const std::int32_t dx : {0, 1}) {
      const CellBelief* belief = Find({corner.x + dx, corner.y + dy});
      if (belief == nullptr) return;
      const double weight =
          (dx == 1 ? right_weight : 1 - right_weight) * (dy == 1 ? upper_weight : 1 - upper_weight);
      elevation_m += weight * static_cast<double>(belief->elevation_m);
      variance_m2 += weight * static_cast<double>(belief->variance_m2);
    }
  }
  sample.elevation_m = static_cast<float>(elevation_m);
  sample.variance_m2 = static_cast<float>(variance_m2);
}

std::optional<float> TerrainReader::SlopeAt(CellIndex cell) {
  const double middle_m = static_cast<double>(Find(cell)->elevation_m);
  PlaneSums sums;
  for (std::int32_t dx = -1; dx <= 1; ++dx) {
    ColumnSums column;
    for (std::int32_t dy = -1; dy <= 1; ++dy) {
      const CellBelief* belief = Find({cell.x + dx, cell.y + dy});
      if (belief != nullptr)
        column.Add(dy, true, static_cast<double>(belief->elevation_m) - middle_m);
    }
    sums.Add(dx, column);
  }
  if (!HasPlane(sums, kSlopeCells_min)) return std::nullopt;
  return SlopeOf(FitPlane(sums), map_.options.cell_size_m);
}

absl::StatusOr<std::vector<GroundSample>> SampleHeights(const MapSnapshot& map,
                                                        const std::vector<Place>& points,
                                                        Abandoned abandoned) {
  TerrainReader reader(map);
  std::vector<GroundSample> samples;
  samples.reserve(points.size());
  for (const Place& point : points) {
    if (samples.size() % kPointsBetweenLooks == 0 && abandoned())
      return absl::CancelledError("nobody waits for the answer any more");
    samples.push_back(reader.AtPlace(point));
  }
  return samples;
}

}  // namespace gem
