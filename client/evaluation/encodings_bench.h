// What cells and points take on the wire, and how long their encoding takes: a recording goes
// through the mappers in this process, and the tiles that come out of it, and its scans, through
// the codecs of the wire. Serves `gem bench encodings`.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "client/evaluation/local_bench.h"
#include "client/scan_source.h"
#include "core/grid/layered_grid.h"
#include "core/local/local_map_options.h"

namespace gem::evaluation {

struct EncodingsBenchOptions {
  LocalMapOptions map = {};
  float submap_length_m = 10;
  double int16_step_m = 0.004;  ///< of points in INT16: what most LiDARs resolve
  std::size_t num_scans_max = 100;
};

/// One layer of all tiles that hold a cell of it. Bytes are of a known cell.
struct LayerCost {
  Layer layer = Layer::kElevation;
  std::size_t num_tiles = 0;
  std::size_t num_cells = 0;
  double raw_bytes = 0;
  double raw_zstd_bytes = 0;  ///< the same bytes in a frame
  double compact_bytes = 0;   ///< cells and bitmap
  double bitmap_bytes = 0;    ///< of them
  /// Of the predictor's residuals, order 0: what a coder that knows their frequencies, and nothing
  /// else, could reach.
  double entropy_bytes = 0;
  Distribution_ms encode, decode;  ///< of a tile's layer, compact
};

/// The same scans in one encoding. Bytes are of a point.
struct ScanCost {
  std::string encoding;
  double bytes = 0;
  Distribution_ms encode, decode;  ///< of a scan
};

struct EncodingsBench {
  std::size_t num_scans = 0;
  std::size_t points = 0;  ///< median of a scan
  std::vector<LayerCost> layers;
  std::vector<ScanCost> scans;
};

/// INVALID_ARGUMENT names the option or a point that does not fit INT16; NOT_FOUND without scans.
absl::StatusOr<EncodingsBench> BenchEncodings(ScanSource& source,
                                              const EncodingsBenchOptions& options);

std::string EncodingsBenchJson(const EncodingsBench& bench);
std::string EncodingsBenchTable(const EncodingsBench& bench);

}  // namespace gem::evaluation
