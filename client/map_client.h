// Reads maps from a server, corrects and manages them: one function per call, with deadlines. Not
// for scans: those go through IngestClient.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "client/connection.h"
#include "client/map_types.h"

namespace gem::client {

/// How the server stores cells on the wire.
enum class CellEncoding {
  kRaw,      ///< exact
  kCompact,  ///< a tenth of the bytes or less; elevation rounded to 1 mm
};

struct MapClientOptions {
  /// Of a call that reads. Range (0, 1e6].
  double deadline_s = 30;
  /// Of a correction, which is answered when the corrected map is published. Range (0, 1e6].
  double correction_deadline_s = 600;
  /// How often a map is read again because the version that was begun with is not kept any more.
  /// Range [1, 1000].
  int consistent_tries_max = 20;
  /// How often a correction is sent if the server is not reached. Range [1, 100].
  int correction_tries_max = 3;
  /// Of a whole map that is exported or imported. Range (0, 1e6].
  double transfer_deadline_s = 3600;
};

/// What a call asks for of the cells.
struct CellSelection {
  std::vector<Layer> layers = {Layer::kElevation};
  CellEncoding encoding = CellEncoding::kCompact;
};

/// Which tiles are read, and what the caller has of them.
struct TileQuery {
  /// Of the pyramid.
  int level = 0;
  /// Nothing: the newest. The server keeps a replaced version for a while, 30 s by default; then
  /// FAILED_PRECONDITION.
  std::optional<MapVersion> at = std::nullopt;
  /// From an earlier call with the same level and selection. Tiles of it that are still the same
  /// are taken from it, and not sent again. May be null.
  const TileSet* held = nullptr;
};

/// Tiles with their geometry, all of one version.
struct TiledMap {
  TileMatrix matrix;
  TileSet tiles;
};

/// Thread-safe. Errors carry the server's code and text, which names the field; UNAVAILABLE names
/// the address.
class MapClient {
 public:
  explicit MapClient(std::shared_ptr<const Connection> connection, MapClientOptions options = {});
  ~MapClient();

  absl::StatusOr<MapInfo> GetMap(const std::string& map) const;
  /// All maps, page by page.
  absl::StatusOr<std::vector<MapInfo>> ListMaps() const;
  /// All submaps of a map. Pages of different versions are read again; ABORTED if the map never
  /// keeps still.
  absl::StatusOr<std::vector<SubmapInfo>> ListSubmaps(const std::string& map) const;
  absl::StatusOr<TileMatrix> GetTileMatrix(const std::string& map, int level = 0) const;

  /// Any number of tiles, in batches, all of one version. ABORTED if that version is forgotten
  /// before the last batch, too often.
  absl::StatusOr<TileSet> GetTiles(const std::string& map, const std::vector<TileIndex>& tiles,
                                   const CellSelection& selection,
                                   const TileQuery& query = {}) const;
  /// The whole map, or the tiles that the region touches; matrix and tiles are of one version.
  /// held: as in TileQuery.
  absl::StatusOr<TiledMap> ReadMap(const std::string& map, const std::optional<Region>& region,
                                   const CellSelection& selection, int level = 0,
                                   const TileSet* held = nullptr) const;

  absl::StatusOr<LocalMap> GetLocalMap(const std::string& robot,
                                       const CellSelection& selection) const;

  /// The ground at 1 to kGroundPoints_max points, all on the version `at`, or the newest.
  absl::StatusOr<GroundHeights> SampleHeights(
      const std::string& map, const std::vector<Place>& points,
      const std::optional<MapVersion>& at = std::nullopt) const;
  /// Whether a robot can follow a path, on the version `at`, or the newest.
  absl::StatusOr<CheckedPath> CheckPath(const std::string& map, const PathQuestion& question,
                                        const std::optional<MapVersion>& at = std::nullopt) const;

  /// Returns when the corrected map is published. Sent again if the server is not reached: the
  /// request id makes that harmless.
  absl::StatusOr<CorrectionResult> CorrectTrajectory(const Correction& correction) const;

  // What changes maps is sent again if the server is not reached: the request id, made if it is
  // empty, makes that harmless.
  absl::StatusOr<MapInfo> CreateMap(const NewMap& map, const std::string& request_id = "") const;
  /// force: also if sessions feed it.
  absl::Status DeleteMap(const std::string& map, bool force,
                         const std::string& request_id = "") const;
  /// All sessions that ever fed a map, by order of arrival.
  absl::StatusOr<std::vector<SessionInfo>> ListSessions(const std::string& map) const;
  /// Takes what a session contributed out of a map, or brings it back.
  absl::StatusOr<RetractionResult> RetractSession(const std::string& map,
                                                  const std::string& session, bool restore,
                                                  const std::string& request_id = "") const;
  /// The map as a file: calls write(bytes) until it is complete, or until write fails. Not sent
  /// again.
  absl::Status ExportMap(const std::string& map,
                         const std::function<absl::Status(absl::string_view)>& write) const;
  /// Makes a map of a file: read(size_max) gives its next bytes, at most so many, and none at the
  /// end. Not sent again, but may be, with the same request id.
  absl::StatusOr<MapInfo> ImportMap(
      const std::string& map, const std::function<absl::StatusOr<std::string>(std::size_t)>& read,
      const std::string& request_id = "") const;

  absl::StatusOr<ServerStatus> GetServerStatus() const;

 private:
  struct Stubs;

  absl::StatusOr<TileSet> GetTilesOnce(const std::string& map, const std::vector<TileIndex>& tiles,
                                       const CellSelection& selection,
                                       const TileQuery& query) const;

  const std::shared_ptr<const Connection> connection_;
  const MapClientOptions options_;
  const std::unique_ptr<const Stubs> stubs_;
};

/// 16 hexadecimal digits that no other call gave: for request ids and session ids.
std::string UniqueId();

}  // namespace gem::client
