// PREDICTOR_MEDIAN of gem.v1.GridLayer: cells as differences from what their neighbours let expect,
// zigzag, lowest bytes first. Knows no protobuf and no zstd. ENCODINGS.md says it byte by byte; the
// vectors in tests/proto/golden hold it still.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "absl/strings/string_view.h"
#include "core/grid/cell_belief.h"

namespace gem::wire {

/// Which cells have a value, by rows of `columns` from the lower left.
struct CellMask {
  std::span<const std::uint8_t> valid;  ///< 1 or 0
  std::size_t columns = 0;              ///< at least 1

  std::size_t num_valid() const;
};

/// Cells that are not valid take no bytes: sizeof(value) for each that is. One value per cell.
std::string EncodeCells(std::span<const std::int16_t> cells, const CellMask& mask);
/// Each channel for itself.
std::string EncodeCells(std::span<const Rgba> cells, const CellMask& mask);

/// data: exactly num_valid() * sizeof(value) bytes; any such bytes are cells. Those that are not
/// valid are 0.
std::vector<std::int16_t> DecodeCells(absl::string_view data, const CellMask& mask);
std::vector<Rgba> DecodeColors(absl::string_view data, const CellMask& mask);

}  // namespace gem::wire
