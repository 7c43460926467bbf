// Requests of gem.v1.TileService, validated.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "core/grid/cell_index.h"
#include "core/grid/layered_grid.h"
#include "core/grid/map_version.h"
#include "core/grid/region.h"
#include "proto/wire/grid.h"

namespace gem::v1 {
class BatchGetTilesRequest;
class GetLocalMapRequest;
class GetTileMatrixRequest;
class StreamTilesRequest;
class WatchLocalMapRequest;
class WatchTilesRequest;
}  // namespace gem::v1

namespace gem::wire {

inline constexpr int kTilesOfBatch_max = 64;
inline constexpr double kMinInterval_sMax = 3600;
inline constexpr std::uint64_t kBytesPerSecondMin = 1024;

/// What of the cells is wanted, and how.
struct CellSelection {
  std::vector<Layer> layers;  ///< by number, each once: the order of a request means nothing
  CellEncoding encoding = CellEncoding::kCompact;
};

struct TileMatrixRequest {
  std::string map;
  int level = 0;
};
absl::StatusOr<TileMatrixRequest> FromProto(const v1::GetTileMatrixRequest& proto);

struct BatchRequest {
  std::string map;
  std::vector<TileAddress> tiles;
  CellSelection cells;
  std::optional<MapVersion> at;
  std::vector<std::uint64_t> if_none_match;  ///< empty, or one for each tile; 0: none
};
absl::StatusOr<BatchRequest> FromProto(const v1::BatchGetTilesRequest& proto);

struct StreamRequest {
  std::string map;
  std::optional<Region> region;
  int level = 0;
  CellSelection cells;
  std::optional<MapVersion> changed_after;
  std::optional<Place> nearest_to;
};
absl::StatusOr<StreamRequest> FromProto(const v1::StreamTilesRequest& proto);

struct WatchRequest {
  std::string map;
  std::optional<Region> region;
  int level = 0;
  CellSelection cells;
  std::optional<MapVersion> resume_from;
  double min_interval_s = 0;
  std::uint64_t bytes_per_s_max = 0;  ///< 0: no limit
  bool keys_only = false;
};
absl::StatusOr<WatchRequest> FromProto(const v1::WatchTilesRequest& proto);

struct LocalMapRequest {
  std::string robot;
  CellSelection cells;
  double min_interval_s = 0;
};
absl::StatusOr<LocalMapRequest> FromProto(const v1::GetLocalMapRequest& proto);
absl::StatusOr<LocalMapRequest> FromProto(const v1::WatchLocalMapRequest& proto);

}  // namespace gem::wire
