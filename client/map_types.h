// What the server tells about maps, as the client library gives it to its users.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/geometry/pose.h"
#include "core/geometry/trajectory.h"
#include "core/grid/cell_index.h"
#include "core/grid/layered_grid.h"
#include "core/grid/map_version.h"
#include "core/grid/terrain.h"

namespace gem::client {

struct MapInfo {
  std::string id;
  double cell_size_m = 0;
  double submap_length_m = 0;
  bool traversable_only = false;
  MapVersion version;
  std::uint64_t num_submaps = 0;
  std::uint64_t num_points = 0;
  std::uint64_t submap_bytes = 0;
  std::uint64_t num_tiles = 0;
  std::vector<std::string> sessions;  ///< the newest, at most 100
  std::uint64_t num_sessions = 0;     ///< that ever fed the map
};

/// A rectangle of G, metres, half open: [x_m_min, x_m_max) x [y_m_min, y_m_max).
struct Region {
  double x_m_min = 0, y_m_min = 0, x_m_max = 0, y_m_max = 0;
};

/// What a new map is to be; what is unset takes the server's default.
struct NewMap {
  std::string map;
  std::optional<float> cell_size_m;
  std::optional<float> submap_length_m;
  bool traversable_only = false;
};

/// A session that fed a map.
struct SessionInfo {
  std::string id;
  std::string robot;
  bool active = false;
  bool retracted = false;    ///< what it contributed is out of the map
  Pose<Global, Odom> T_G_O;  ///< at its newest pose
  std::uint64_t num_submaps = 0;
  std::uint64_t num_points = 0;
};

struct RetractionResult {
  MapVersion version;  ///< shows it
  std::uint32_t num_submaps = 0;
  std::uint64_t num_merged_points = 0;
  std::uint32_t num_touched_tiles = 0;
};

struct SubmapInfo {
  std::uint64_t id = 0;
  std::string session;
  std::vector<std::string> robots;
  Pose<Global, Submap> T_G_K;
  std::int64_t anchor_stamp_ns = 0;
  std::uint64_t num_points = 0;
  std::int64_t first_stamp_ns = 0;
  std::int64_t last_stamp_ns = 0;
  bool finished = false;
  std::optional<Region> extent = std::nullopt;  ///< of its cells; nothing if it lies on its side
  std::vector<std::string> sessions = {};       ///< whose scans are in it
};

/// Geometry and extent of a level of a map's tiles.
struct TileMatrix {
  int level = 0;                  ///< of the pyramid: 0 has the map's cell size
  int level_max = 0;              ///< the coarsest that there is
  double cell_size_m = 0;         ///< at the level: doubles from one to the next
  float traversability_free = 0;  ///< cells above this are free
  std::vector<TileIndex> tiles;   ///< all of the level that hold cells, by row, then column
  MapVersion version;
};

/// One tile: kTileCells x kTileCells cells of G.
struct MapTile {
  TileIndex index;
  MapVersion version;      ///< of its last change
  std::uint64_t etag = 0;  ///< of its cells in the layers and encoding that were asked for; 0: none
  std::shared_ptr<const LayeredGrid> grid;  ///< null: no cell of it is known
};

/// Tiles of one version.
struct TileSet {
  MapVersion version;
  std::vector<MapTile> tiles;
};

/// The newest robocentric map of a robot. Frame O.
struct LocalMap {
  std::int64_t stamp_ns = 0;  ///< of the newest fused scan
  std::uint64_t seq = 0;      ///< of that scan
  CellIndex origin;           ///< cell of O at column 0, row 0
  LayeredGrid grid;
  Pose<Odom, Base> T_O_B;    ///< at the stamp
  Pose<Global, Odom> T_G_O;  ///< at the stamp, from the newest correction
  std::string session;
  float traversability_free = 0;  ///< cells above this are free
};

/// The ground at points, in their order.
struct GroundHeights {
  std::vector<GroundSample> samples;
  MapVersion version;  ///< that all were read from
};

/// What became of a question about a path.
struct CheckedPath {
  PathCheck check;
  MapVersion version;  ///< that was asked
};

/// SLAM's corrected trajectory of one session.
struct Correction {
  std::string map;
  std::string session;
  std::string request_id;  ///< a request with the id of an earlier one changes nothing; empty: made
  std::vector<StampedPose<Global, Base>> poses;  ///< the whole trajectory, increasing stamps
};

struct CorrectionResult {
  MapVersion version;  ///< shows the correction
  std::uint32_t num_moved_submaps = 0;
  std::uint32_t num_touched_tiles = 0;
  std::uint32_t num_poses_ahead = 0;    ///< kept until the session reaches their stamp
  std::uint32_t num_poses_ignored = 0;  ///< before the session began
};

struct SessionStatus {
  std::string map;
  std::string robot;
  std::string session;
  bool active = false;
  bool connected = false;
  std::uint64_t num_scans_fused = 0;
  std::uint64_t num_scans_refused = 0;
  std::uint64_t num_scans_dropped = 0;
  std::uint64_t queue_bytes = 0;
  std::uint64_t fused_seq = 0;
  double oldest_s = 0;  ///< age of the oldest scan that waits or is in hand
};

/// How many took at most upper_s; the last bucket's is infinite.
struct TimingBucket {
  double upper_s = 0;
  std::uint64_t count = 0;
};

struct StageTiming {
  std::string mapper;  ///< "local", "global" or "service"
  std::string stage;
  std::uint64_t count = 0;
  double total_s = 0;
  double max_s = 0;
  std::vector<TimingBucket> buckets = {};
};

/// One RPC since the server's start. A stream is one call.
struct CallStatus {
  std::string method;
  std::uint64_t num_started = 0;
  std::uint64_t num_failed = 0;
  std::uint32_t num_active = 0;
  std::uint64_t received_bytes = 0;
  std::uint64_t sent_bytes = 0;
  double total_s = 0;  ///< of those that ended
  std::vector<TimingBucket> buckets = {};
};

/// How far a map is behind its robots.
struct MapLag {
  std::string map;
  double staleness_s = 0;    ///< age of the oldest news that no version shows
  double version_age_s = 0;  ///< grows without robots
  std::uint32_t num_corrections_waiting = 0;
};

struct ProcessStatus {
  std::uint64_t resident_bytes = 0;
  double cpu_s = 0;
  std::uint32_t num_threads = 0;
  std::uint32_t num_open_files = 0;
};

/// Tiles in answers since the server's start.
struct TilesServed {
  std::uint64_t num_full = 0;
  std::uint64_t num_absent = 0;
};

struct ServerStatus {
  std::string server_version;
  std::string backend;
  double uptime_s = 0;
  std::vector<SessionStatus> sessions;
  std::vector<StageTiming> timings;
  std::vector<CallStatus> calls = {};
  std::vector<MapLag> lags = {};
  ProcessStatus process = {};
  TilesServed tiles = {};
};

}  // namespace gem::client
