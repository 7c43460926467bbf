// gem.v1.Grid <-> LayeredGrid: the encoding of cells (raw, or int16, predicted and compressed) and
// its bounded decoding.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "core/grid/layered_grid.h"
#include "proto/wire/field_path.h"

namespace gem::v1 {
class Grid;
}  // namespace gem::v1

namespace gem::wire {

inline constexpr std::int32_t kGridCells_max = 1024;  ///< a side

/// Numbers of gem.v1.CellEncoding.
enum class CellEncoding : std::uint8_t { kRaw = 1, kCompact = 2 };

/// The layers that a request names by their numbers; none means elevation. Refuses what is unknown,
/// not in `served`, or named twice.
absl::StatusOr<std::vector<Layer>> LayersFromProto(const std::vector<int>& layers,
                                                   const std::vector<Layer>& served,
                                                   const FieldPath& field);
/// 0 means compact. Refuses unknown numbers.
absl::StatusOr<CellEncoding> EncodingFromProto(int encoding, const FieldPath& field);
/// gem.v1.Layer.
int ToProto(Layer layer);

/// The same grid gives the same bytes.
void ToProto(const LayeredGrid& grid, CellEncoding encoding, v1::Grid* proto);

/// Refuses more than side_cells_max cells a side, layers whose size does not fit, zstd frames whose
/// size is not exactly what the cells need (they are never inflated further), and values that are
/// not finite.
absl::StatusOr<LayeredGrid> FromProto(const v1::Grid& proto, std::int32_t side_cells_max,
                                      const FieldPath& field);

}  // namespace gem::wire
