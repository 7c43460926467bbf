// Keeps a region of a map up to date: watches it, puts changes together, comes back after a
// disconnect with what it has, and starts over where that is of no use. Readers get immutable
// snapshots.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "client/connection.h"
#include "client/map_client.h"
#include "client/mirrored_map.h"
#include "client/retry_thread.h"
#include "client/watch_state.h"

namespace gem::client {

struct MirrorOptions {
  std::string map;
  /// Nothing: the whole map, as it grows.
  std::optional<Region> region;
  /// Of the pyramid: each level halves the resolution.
  int level = 0;
  CellSelection cells = {{Layer::kElevation, Layer::kTraversability}, CellEncoding::kCompact};
  /// Changes come at most this often, seconds. Range [0, 3600].
  double min_interval_s = 0;
  /// The server sends at most so many bytes a second on average; 0: as many as the connection
  /// takes, else at least 1024.
  std::uint64_t bytes_per_s_max = 0;
  /// What is held at most; a tile takes 80 KiB a layer. Beyond it the mirror ends.
  std::size_t tiles_max = 65'536;
  /// Between tries to reach the server.
  RetryOptions retry;
  /// Called for every new version, from the mirror's thread, which waits for it; `changed` are the
  /// tiles that differ from the version before, those that went among them. Must not destroy the
  /// mirror.
  std::function<void(const std::shared_ptr<const MirroredMap>& map,
                     const std::vector<TileIndex>& changed)>
      on_version;
};

struct MirrorStats : WatchStats {
  std::uint64_t num_versions = 0;          ///< shown
  std::uint64_t num_versions_skipped = 0;  ///< published, but never seen here
  std::uint64_t num_resyncs = 0;  ///< changes with which everything came again, the first not
};

/// Thread-safe.
class MapMirror {
 public:
  /// Begins at once; a server or a map that is not there yet is waited for.
  MapMirror(std::shared_ptr<const Connection> connection, MirrorOptions options);
  /// Ends the watch. Snapshots stay valid.
  ~MapMirror();
  MapMirror(const MapMirror&) = delete;
  MapMirror& operator=(const MapMirror&) = delete;

  /// The newest complete version; null before the first. Takes no lock of the mirror.
  std::shared_ptr<const MirroredMap> map() const;

  /// Waits for a version other than `than`; nothing: for any. DEADLINE_EXCEEDED after timeout_s
  /// carries why the server is not reached, if it is not; other errors are those that ended the
  /// mirror.
  absl::StatusOr<std::shared_ptr<const MirroredMap>> WaitForOther(
      const std::optional<MapVersion>& than, double timeout_s) const;

  MirrorStats stats() const;

 private:
  class Impl;
  const std::unique_ptr<Impl> impl_;
};

}  // namespace gem::client
