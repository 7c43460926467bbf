// ESRI ASCII grids: the text format of heights that every GIS reads. Read by the simulator as
// terrain, written by the exports.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

namespace gem {

/// Cells by rows from the lower left: index = row * columns + column. (The file has the north row
/// first.)
struct EsriAsciiGrid {
  std::int32_t columns = 0;
  std::int32_t rows = 0;
  double x_m_min = 0;  ///< lower left corner of the lower left cell
  double y_m_min = 0;
  double cell_size_m = 0;
  std::vector<float> values;        ///< zero where not valid
  std::vector<std::uint8_t> valid;  ///< 1 where the cell has a value

  std::size_t num_cells() const { return values.size(); }
};

/// Cells of the largest grid that is read or written.
inline constexpr std::int64_t kEsriAsciiCellsMax = std::int64_t{1} << 28;

/// Header keys in any case and order; xllcenter, yllcenter and a missing NODATA_value are
/// understood. Errors: "dem.asc:3: ...".
absl::StatusOr<EsriAsciiGrid> ReadEsriAscii(const std::string& path);

/// The file's text. Nine digits, so that every float is read back as it was; not valid is -9999.
std::string ToEsriAscii(const EsriAsciiGrid& grid);

}  // namespace gem
